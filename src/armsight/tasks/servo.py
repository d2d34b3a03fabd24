"""V's tasks: follow a target that moves, and touch it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import JointState
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, transform
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
from armsight.motion.intents import Intent, Rest, VelocityIntent
from armsight.motion.permits import PermitRequest
from armsight.motion.task import Observation, Subscriptions
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.approach import Funnel
from armsight.servoing.docking import DOCK_NAMES, Docking, docking
from armsight.servoing.eyes import Eye, WristEye
from armsight.servoing.law import LawConfig
from armsight.servoing.modes import Chase, ChaseConfig, make_chase, tool_direction
from armsight.servoing.segments import SegmentConfig
from armsight.servoing.sighting import Look, Looks
from armsight.servoing.targets.ball import Ball

if TYPE_CHECKING:
    from armsight.workcell import Cell
    from armsight.workcell.schema import Workcell

Triple = tuple[float, float, float]
Mode = Literal["ours", "paper", "fixed"]
TOUCH = 0.005
"""The tip touches when it is this near the surface (V's criterion) [m]."""
ASK_WITHIN = 2.0
"""A permit is asked for from here on [m]: other links of the arm come near the target, too."""
TOOL_MARKS = {"pen": (0.005, (0.0, 0.0, -0.005))}
"""Balls on tools that the pair can see: radius [m], and place in the TCP's frame [m]."""


@dataclass(frozen=True)
class ServoOptions:
    """Follow a target that moves until the tool touches it, or docks with it (V).

    Attributes:
        target: what to follow: the ball, the bulls-eye, a mouth with a `straw`, or a `hand`.
        mode: `ours`; `paper`: V's Master and its stop-and-go segments; `fixed`: those without the
            pair on the wrist.
        standoff: how far before the surface the tip stays [m]; 0 touches.
        ball_radius: of the red ball [m].
    """

    target: Literal["ball", "bullseye", "straw", "hand"] = "ball"
    mode: Mode = "ours"
    standoff: float = 0.0
    ball_radius: float = 0.04

    def make(self, cell: Cell) -> ServoTask:
        """The task for a cell.

        Raises:
            UsageError: the cell has no camera with colour, or the mode needs a pair it lacks.
        """
        cameras = [c.info.name for c in cell.cameras if c.info.color is not None]
        if not cameras:
            raise UsageError(
                f"{cell.workcell.name}: no camera with a colour lens; a target is found by colour"
            )
        pairs = [p.info.name for p in cell.stereo if p.info.mounted_on == "flange"]
        pair = pairs[0] if pairs and self.mode != "fixed" else ""
        dock = docking(self.target, self.ball_radius)
        target = dock.detector()
        eyes: list[Eye | WristEye] = [Eye(name, target) for name in cameras]
        if pair:
            tool = cell.robot.tool.name if cell.robot.tool is not None else ""
            radius, at = TOOL_MARKS.get(tool, (0.0, (0.0, 0.0, 0.0)))
            mark = Ball(radius, "mark") if radius else None
            eyes.append(
                WristEye(pair, target, cell.robot, mark, np.array(at), self.mode == "paper")
            )
        config = chase_config(cell.workcell, cell.T_world_base, dock, self.standoff)
        names = [*cameras, *([pair] if pair else [])]
        chase = make_chase(self.mode, cell.robot, names, pair, config)
        return ServoTask(dock, self.mode, chase, eyes, config, self.standoff)


class ServoTask:
    """Follows a target and touches it.

    Args:
        dock: what it is and how it is touched; mode: how it is come to.
        chase: turns looks into joint velocities.
        eyes: the perceivers.
        config: of the chase.
        standoff: how far before it the tip stays [m].

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
    ) -> None:
        self.dock, self.mode, self.chase = dock, mode, chase
        self.config, self.standoff = config, standoff
        self.perceivers = tuple(eyes)
        self.subscriptions = Subscriptions(perceivers=tuple(eye.name for eye in eyes))
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        self.chase.reset()
        self._looks: dict[str, Look] = {}
        self.touches: list[float] = []
        self._touching = False
        self._face = Face("wait")
        self._latency = math.nan
        self._pausing = False

    def update(self, observation: Observation) -> Intent:
        """See :class:`~armsight.motion.task.Task`."""
        now, joints = observation.now, observation.joints
        self._take(observation)
        if joints is None:
            return Rest("no joint reading yet")
        wish = self.chase.step(now, joints, observation.guard)
        error = self.chase.distance
        touching = error < TOUCH
        if touching and not self._touching:
            self.touches.append(now)
        self._touching = touching
        self._face = self._show(observation.robot, joints, now, touching)
        if wish is None:
            return Rest(self.chase.reason)
        permit = None if self.standoff > 0.0 else self._permit(observation)
        return VelocityIntent(
            self.dock.name,
            wish.velocity,
            "joint",
            wish.exposure,
            wish.exposure + wish.lasts,
            permit,
        )

    def _permit(self, observation: Observation) -> PermitRequest | None:
        """Asks to touch the target, as far as anybody knows where it is.

        One that was withdrawn is asked for again after a round without it.
        """
        seen = self.chase.touchable()
        guard = observation.guard
        if seen is None or self.chase.distance > ASK_WITHIN:
            return None
        lost = guard is not None and guard.permit is not None and not guard.permit.holds
        if lost and not self._pausing:
            self._pausing = True
            return None
        self._pausing = False
        axis, _ = tool_direction(self.config, seen.position, seen.normal)
        return self.dock.request(seen, -axis, self.config.vertical)

    def face(self) -> Face:
        """What the page shows."""
        return self._face

    def _take(self, observation: Observation) -> None:
        """Everything that has been seen since the last round, in the order of exposure."""
        fresh = []
        for perceived in observation.perceived:
            if isinstance(perceived.evidence, Looks):
                for look in perceived.evidence.looks:
                    last = self._looks.get(look.camera)
                    if last is None or look.stamp > last.stamp:
                        self._looks[look.camera] = look
                        fresh.append(look)
        for look in sorted(fresh, key=lambda look: look.stamp):
            self.chase.see(look)
            self._latency = observation.now - look.stamp

    def _show(self, robot: Robot, joints: JointState, now: float, touching: bool) -> Face:
        chase = self.chase
        tip = tcp_pose(robot, joints.position)[:3, 3]
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
            ahead, _ = estimate.at(now + 0.1)
            marks.append(PointsMark("prediction", ahead[None], 0.008, (240, 190, 30)))
        pictures = tuple(
            Picture(name, look.picture)
            for name, look in sorted(self._looks.items())
            if look.picture is not None
        )
        distance = 1e3 * chase.distance
        return Face(
            state="touch" if touching else chase.state,
            reason=chase.reason,
            figures=(
                Figure("touches", float(len(self.touches))),
                Figure("switches", float(chase.switches)),
                Figure("iterations", float(chase.iterations)),
                Figure("latency", 1e3 * self._latency, "ms"),
                Figure("first touch", self.touches[0] if self.touches else math.nan, "s"),
            ),
            curves=(
                Curve("distance", distance if math.isfinite(distance) else math.nan, "mm"),
                Curve("source", float(chase.source_number)),
            ),
            pictures=pictures,
            marks=tuple(marks),
        )


def chase_config(
    workcell: Workcell, T_world_base: Pose, dock: Docking, standoff: float = 0.0
) -> ChaseConfig:
    """What a chase has to know of a cell.

    Args:
        workcell: the cell.
        T_world_base: where its robot stands.
        dock: what is servoed to.
        standoff: how far before it the tip stays [m]; 0 for what the docking says.
    """
    section = workcell.robot
    T_base_world = inverse(T_world_base)
    lower, upper = _box(workcell.mapping.lower, workcell.mapping.upper, T_base_world)
    speed = section.speed * workcell.guard.speed
    return ChaseConfig(
        vertical=T_base_world[:3, 2],
        front=T_base_world[:3, 0],
        radius=dock.radius,
        direction=dock.direction,
        funnel=Funnel(gap=standoff if standoff > 0.0 else dock.gap),
        law=LawConfig(
            delay=section.start_delay_ms / 1e3 + 0.002,
            speed=speed,
            acceleration=section.acceleration,
        ),
        segments=SegmentConfig(
            speed=speed, acceleration=section.acceleration, lower=lower, upper=upper
        ),
    )


def _box(lower: Triple | None, upper: Triple | None, T_base_world: Pose) -> tuple[Triple, Triple]:
    """The mapped box as an upright box of ``base``; endless where the cell declares none."""
    if lower is None or upper is None:
        return (-math.inf,) * 3, (math.inf,) * 3
    corners = transform(T_base_world, np.array([lower, upper]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


__all__ = ["DOCK_NAMES", "Mode", "ServoOptions", "ServoTask"]
