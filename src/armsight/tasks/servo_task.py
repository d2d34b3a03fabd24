"""The task of visual servoing: follow a target, ask to touch it, show what is known of it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Literal

import numpy as np

from armsight.devices.data import JointState
from armsight.motion.asking import AskAnew
from armsight.motion.data import GuardStatus
from armsight.motion.face import (
    ArrowMark,
    Curve,
    EllipsoidMark,
    Face,
    Figure,
    Mark,
    Picture,
    PointsMark,
)
from armsight.motion.intents import FUTURE, Intent, PoseIntent, Rest, VelocityIntent
from armsight.motion.permits import PermitRequest
from armsight.motion.task import Observation, Subscriptions
from armsight.robots.kinematics import tcp_pose
from armsight.robots.sprung_tip import press_depth
from armsight.servoing.aim import Aim
from armsight.servoing.creeping import STILL, Creeping
from armsight.servoing.detour import BEFORE, Detour
from armsight.servoing.docking import Docking
from armsight.servoing.eyes import Eye, WristEye
from armsight.servoing.hindrance import Hindrance, Reach
from armsight.servoing.lookout import Lookout
from armsight.servoing.modes import SEEN_WITHIN, Chase, ChaseConfig, make_chase, tool_direction
from armsight.servoing.patience import STATED, Patience
from armsight.servoing.sighting import Look, Looks, Sighting

Mode = Literal["ours", "paper", "fixed"]
NEAR = 0.03
"""So near to where a planned way would lead none is asked for [m]."""
TOUCH = 0.005
"""The tip touches when it is this near the surface (V's criterion) [m]."""
ASK_WITHIN = 2.0
"""A permit is asked for from here on [m]: other links of the arm come near the target, too."""
FELT = 1.0
"""Less force than this is the tool's own inertia, and noise [N]."""
ASIDE, BESIDE = 64, 0.05
"""Rounds in which the tip was pushed that are remembered; a picture so long before or after one of
them [s] may show it out of its seat."""
EASES = 0.02
"""What is felt counts by its mean over about this time [s]."""
GIVES = 0.05
"""The tip gives way by this much at most [m]; what still presses then ends the permit."""


class ServoTask:
    """Follows a target and touches it.

    Args:
        dock: what it is and how it is touched; mode: how it is come to.
        chase: turns looks into joint velocities.
        eyes: the perceivers.
        config: of the chase.
        standoff: how far before it the tip stays [m].
        patience: a target that stays refused, out of reach or behind something for so long is given
            up [s].

    Attributes:
        touches: when the tip came to touch the target, as far as is known [s].
    """

    name = "servo"
    period = 0.008
    latency = 0.002

    def __init__(
        self,
        dock: Docking,
        mode: Mode,
        chase: Chase,
        eyes: list[Eye | WristEye],
        config: ChaseConfig,
        standoff: float = 0.0,
        patience: float = STATED,
    ) -> None:
        self.dock, self.mode, self.chase = dock, mode, chase
        self.config, self.standoff = config, standoff
        self.perceivers = tuple(eyes)
        self.detour = Detour(f"way to {dock.name}", dock.planned)
        self.patience = Patience(patience)
        reach = Reach(chase.robot, config.weights, config.law.ceiling)
        self.hindrance = Hindrance(reach)
        self.lookout = Lookout(np.array(chase.robot.home, float))
        self.creeping = Creeping(dock.creeps if standoff == 0.0 else 0.0)
        self.subscriptions = Subscriptions(perceivers=tuple(eye.name for eye in eyes))
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        self.chase.reset()
        self.detour.reset()
        self.creeping.reset()
        self.patience.reset()
        self.hindrance.reset()
        self.lookout.reset()
        self._looks: dict[str, Look] = {}
        self.touches: list[float] = []
        self._touching = False
        self._face = Face("wait")
        self._latency = math.nan
        self._ahead = ""
        self._asking = AskAnew()
        self._felt = 0.0
        self._aside: deque[float] = deque(maxlen=ASIDE)

    def warm_up(self) -> None:
        """Compile the laws: a chase of its own goes after a made-up target."""
        robot, config = self.chase.robot, self.config
        chase = make_chase(self.mode, robot, ("rehearsal",), "", config)
        home = np.array(robot.home, float)
        place = tcp_pose(robot, home)[:3, 3] + 0.2 * config.front
        for stamp in (1.0, 1.1, 1.2):
            seen = Sighting(self.dock.name, "rehearsal", stamp, place, 1e-6 * np.eye(3), place)
            chase.see(Look("rehearsal", stamp, False, np.eye(4), (seen,)))
            chase.step(stamp + 0.05, JointState(stamp + 0.05, home, np.zeros(robot.n)), None)
            chase.before(BEFORE)

    def update(self, observation: Observation) -> Intent:
        """See :class:`~armsight.motion.task.Task`."""
        now, joints = observation.now, observation.joints
        self._take(observation)
        if joints is None:
            return Rest("no joint reading yet")
        self.chase.give = self._give(observation.guard) - self._creep(now, observation.guard)
        wish = self.chase.step(now, joints, observation.guard)
        error = self.chase.distance
        touching = error < TOUCH
        if touching and not self._touching:
            self.touches.append(now)
        self._touching = touching
        answer = None if observation.guard is None else observation.guard.permit
        hindered = self._hindered(now, joints, observation.guard)
        gave_up = self.patience.update(now, answer, self.chase.place, hindered)
        self._face = self._show(observation, joints, touching)
        if wish is None or gave_up:
            unseen = self.chase.place is None and not self._ahead and self.mode == "ours"
            elsewhere = self.lookout.update(now, joints.position) if unseen else None
            return elsewhere or Rest(self._ahead or gave_up or self.chase.reason)
        self.lookout.reset()
        permit = self._permit(observation)
        around = self._around(now, observation.guard)
        if around is not None:
            self.chase.led()
            return replace(around, permit=permit)
        return VelocityIntent(
            self.dock.name,
            wish.velocity,
            "joint",
            wish.exposure,
            wish.exposure + wish.lasts,
            permit,
        )

    def _hindered(self, now: float, joints: JointState, guard: GuardStatus | None) -> str:
        """Why the tip does not come to its target, in words; empty where it does."""
        config, place, seen = self.chase.config, self.chase.place, self.chase.touchable()
        if place is None or seen is None:
            return self.hindrance.update(now, math.inf, None, joints.position, guard, False)
        axis, down = tool_direction(config, place, seen.normal)
        gap = max(config.funnel.gap, 0.0)
        aim = Aim(place - (config.radius + gap) * axis, np.zeros(3), axis, down)
        may = guard is not None and guard.permit is not None and guard.permit.holds
        left = self.chase.distance - gap
        return self.hindrance.update(
            now, left, aim, joints.position, guard, may, self.detour.failed
        )

    def _around(self, now: float, guard: GuardStatus | None) -> PoseIntent | None:
        """A planned way, where the own one is blocked."""
        seen, far = self.chase.touchable(), self.chase.distance > BEFORE + NEAR
        if not far and not self.detour.going:
            return None  # what holds the arm here is the permit's own law
        if seen is None or self.mode != "ours":
            return None
        gap = max(self.chase.config.funnel.gap, BEFORE)
        return self.detour.update(now, guard, seen.position, lambda: self.chase.before(gap))

    def _permit(self, observation: Observation) -> PermitRequest | None:
        """Asks to touch the target, as far as anybody knows where it is.

        Who follows a thing at a stand-off asks as well: what is not declared may be a person.
        """
        seen = self.chase.touchable()
        guard = observation.guard
        if seen is None or self.chase.distance > ASK_WITHIN:
            return None
        if self.standoff > 0.0 and self.dock.permit != "thing":
            return None  # it follows somebody as far away as the guard wants it
        if not self._asking.may_ask(guard):
            return None
        axis, _ = tool_direction(self.config, seen.position, seen.normal)
        return self.dock.request(seen, -axis, self.config.vertical, self.config.front)

    def _give(self, guard: GuardStatus | None) -> float:
        """How far the tip gives way to what presses [m]: that much is bent by what is felt.

        A goal behind a surface that yields is followed for ever: the eyes see the surface go back.
        A tip on springs is pressed farther by as much.
        """
        permit = None if guard is None else guard.permit
        felt = 0.0 if permit is None or math.isnan(permit.pressed) else permit.pressed
        self._felt += (felt - self._felt) * min(1.0, self.period / EASES)
        hold, tip = self.dock.stiffness, self.config.tip
        bent = press_depth(self._felt, hold, tip) - press_depth(FELT, hold, tip)
        return min(max(bent, 0.0), GIVES)

    def _creep(self, now: float, guard: GuardStatus | None) -> float:
        """How far the tip goes on behind where the surface should be, until it feels it [m]."""
        permit, seen = None if guard is None else guard.permit, self.chase.estimate
        stands = (
            permit is not None
            and permit.holds
            and seen is not None
            and now - seen.seen < SEEN_WITHIN
            and float(np.linalg.norm(seen.velocity)) < STILL
            and self.chase.distance < TOUCH + self.creeping.by
        )
        pressed = math.nan if permit is None else permit.pressed
        return self.creeping.update(now, stands, pressed, FELT)

    def face(self) -> Face:
        """What the page shows."""
        return self._face

    def _take(self, observation: Observation) -> None:
        """Everything that has been seen since the last round, in the order of exposure."""
        self._note_aside(observation.now, observation.guard)
        fresh = []
        for perceived in observation.perceived:
            if isinstance(perceived.evidence, Looks):
                for look in perceived.evidence.looks:
                    if look.stamp > observation.now + FUTURE:
                        late = look.stamp - observation.now
                        self._ahead = (
                            f"{look.camera}: seen {late:.3f} s in the future; check clocks"
                        )
                        continue
                    last = self._looks.get(look.camera)
                    if last is None or look.stamp > last.stamp:
                        self._looks[look.camera] = look
                        fresh.append(look)
        for look in sorted(fresh, key=lambda look: look.stamp):
            # The pair learns its own place from the mark on a tip that is in its seat.
            if any(abs(look.stamp - at) < BESIDE for at in self._aside):
                look = replace(look, mark=None)
            self.chase.see(look)
            self._ahead = self._ahead if not look.sightings else ""
            self._latency = observation.now - look.stamp

    def _note_aside(self, now: float, guard: GuardStatus | None) -> None:
        """Remember when a tip on springs, or a straw, may have been out of its place."""
        permit, tip = None if guard is None else guard.permit, self.config.tip
        if tip is None and self.dock.permit != "face":
            return  # a face is touched by what is soft, and bends: anything else stays as it is
        pressed = math.nan if permit is None else permit.pressed
        if pressed > (FELT if tip is None else tip.seat / 2.0) or self.chase.distance < 0.0:
            self._aside.append(now)

    def _missed(self) -> str:
        """That nothing was felt where the target should be, in words; empty otherwise."""
        if not self.creeping.missed:
            return ""
        return f"felt nothing {1e3 * self.creeping.by:.0f} mm behind where the surface should be"

    def _show(self, observation: Observation, joints: JointState, touching: bool) -> Face:
        chase, guard = self.chase, observation.guard
        pressed = math.nan if guard is None or guard.permit is None else guard.permit.pressed
        tip = tcp_pose(observation.robot, joints.position)[:3, 3]
        place = chase.place
        marks: list[Mark] = []
        if place is not None:
            marks.append(ArrowMark("goal", tip, place, (40, 180, 60)))
            marks.append(PointsMark("target", place[None], 0.012, (230, 40, 40)))
        estimate = chase.estimate
        if estimate is not None:
            marks.append(
                EllipsoidMark.of("estimate", estimate.position, estimate.covariance[:3, :3], 3.0)
            )
            ahead, _ = estimate.at(observation.now + 0.1)
            marks.append(PointsMark("prediction", ahead[None], 0.008, (240, 190, 30)))
        pictures = tuple(
            Picture(name, look.picture)
            for name, look in sorted(self._looks.items())
            if look.picture is not None
        )
        distance = 1e3 * chase.distance
        return Face(
            state="gave up" if self.patience.gave_up else "touch" if touching else chase.state,
            reason=self.patience.gave_up
            or self._missed()
            or self.hindrance.words
            or chase.warning
            or chase.reason,
            figures=(
                Figure("touches", float(len(self.touches))),
                Figure("switches", float(chase.switches)),
                Figure("iterations", float(chase.iterations)),
                Figure("latency", 1e3 * self._latency, "ms"),
                Figure("first touch", self.touches[0] if self.touches else math.nan, "s"),
            ),
            curves=(
                Curve("distance", distance if math.isfinite(distance) else math.nan, "mm"),
                Curve("force", pressed, "N"),
                Curve("source", float(chase.source_number)),
            ),
            pictures=pictures,
            marks=tuple(marks),
        )
