"""The one door to the arm: every motion of every task passes here, and nobody is touched.

Each tick (design page "guard" 5.10): judge the input, follow the planned path or react, let
separation scale the motion, keep a verified stop in hand, and say what is done and why.

Why nobody is touched by an arm that moves. Before a command is sent, the stop after it is looked at
(:meth:`.SeparationMonitor.stops_in_time`): the arm does what it is told for two ticks more, then
every joint brakes as hard as it can; meanwhile every hazard comes straight at it with v_h,
beginning at the exposure of the oldest living camera's picture. If anybody could be within K of a
part before that part stands, the command is not sent; the arm brakes now. That is in time: the
command before was sent because braking *after* it would be, and nothing that a picture shows later
can be nearer than what was counted with. So, tick by tick, there is always a stop that ends in
time, and it is being executed or still possible. It holds as long as

* nothing of a person is faster than v_h (2.0 m/s), and what is not in the map is at most C deep in
  seen space; hazards are where the map has them within Z_d, the arm's parts within Z_r of where
  their joints say (its stop is looked at in five places: the way between them bends by 4 mm);
* the drives answer within ``start_delay`` and brake by the joints' acceleration times ``brake``;
* a tick is late by no more than a period. A later one is a fault, answered by slowing down.

The law of :mod:`armsight.motion.separation` is stricter (it counts with the longest age a picture
may have, and with what closes in only), so the arm slows smoothly long before it must brake.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdCameraInfo
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import ArmState, DelayedArm
from armsight.motion.collision import CollisionModel
from armsight.motion.data import GuardMode, GuardStatus, JointGoal, PlanRequest
from armsight.motion.escape import leaves
from armsight.motion.executed import Executed, thinned
from armsight.motion.faults import FaultWatch, Severity, Verdict
from armsight.motion.goals import Goals
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards, MovingBody, SeparationView
from armsight.motion.plan import Plan
from armsight.motion.reflex import FLEE, Reflex, ReflexStage
from armsight.motion.route import Route, SpeedScale, rate_bounds
from armsight.motion.separation import ReactionTime
from armsight.motion.separation_monitor import (
    TICKS,
    SeparationMonitor,
    after_decision,
    declared_reaction,
)
from armsight.robots.robot import Robot

STANDING = 0.01
"""Joint speed below which the arm is at rest [rad/s]."""
LAG = 0.1
"""Share by which the drives' ramp may lag behind the allowed speed before the brakes are used."""
LEAD = 0.75
"""The command is the motion's velocity this far into the coming tick: the drives ramp up to it."""
STOP_ROOM = 0.04
"""Phase time that is kept free before a blocked place, besides the way to stop [s]."""
CRAWL = 0.1
"""An arm that separation lets go on at less than this share of the planned speed is waiting."""
BLOCKED_FOR = 0.1
"""A path must be blocked for this long before another is asked for [s]: noise flickers."""


@dataclass(frozen=True)
class GuardDecision:
    """One tick's outcome.

    Attributes:
        command: (n,) joint velocities to send [rad/s].
        status: for everybody.
        request: a new plan request, or None.
        brake: stop the arm as hard as the drives can; ``command`` is zero then.
    """

    command: JointVector
    status: GuardStatus
    request: PlanRequest | None = None
    brake: bool = False


@dataclass
class _Tick:
    """What one tick finds and decides.

    ``near`` is how far hazards are from the body as it is; ``view`` what separation says of the
    motion (the same while there is none), and ``pace`` the share of the motion under way.
    """

    now: float
    elapsed: float
    verdict: Verdict
    snapshot: WorkspaceSnapshot | None
    here: ArmState
    ahead: ArmState
    at_rest: bool
    command: JointVector
    near: SeparationView
    view: SeparationView
    pace: float = 0.0
    mode: GuardMode = GuardMode.IDLE
    reason: str = ""
    brake: bool = False
    scale: float = 0.0
    request: PlanRequest | None = None


class Guard:
    """Guards one arm. Knows no thread and no clock: time comes in.

    Args:
        robot: the arm with its tool; needs link spheres.
        cameras: whose pictures must be fresh.
        static: declared solids in ``base``. The map holds them too; the planner's proof of the
            path keeps away from them (v_h = 0). Here they only give names to what blocks a goal.
        config: settings.
        model: collision checks; made for the robot if left out.

    Raises:
        ValueError: the robot has no spheres, so nothing of it could be protected.
    """

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        static: Sequence[Solid] = (),
        config: GuardConfig | None = None,
        model: CollisionModel | None = None,
    ) -> None:
        self.config = config = config or GuardConfig()
        self.robot = robot
        self.static = tuple(static)
        limits = robot.limits.scaled(config.speed, config.acceleration)
        brake = robot.limits.acceleration * max(config.brake, config.acceleration)
        self._limits = limits
        self._arm = DelayedArm(config.start_delay, limits.acceleration, brake)
        self._gate = SeparationMonitor(robot, config, brake)
        self._model = model or CollisionModel(robot)
        self._watch = FaultWatch(robot, cameras, config)
        self._after_decision = after_decision(config)
        self._reaction = ReactionTime(declared_reaction(cameras, config), config.reaction_window)
        self._goals = Goals(robot, config)
        self._scale = SpeedScale(config.rise, config.rise_jerk)
        self._reflex = Reflex(config, robot.limits.scaled(*config.planned))
        self._executed = Executed()
        self._route: Route | None = None
        self._leaving = False
        self._hazards = Hazards.at(np.empty((0, 3)), 0.0)
        self._snapshot: WorkspaceSnapshot | None = None
        self._proof: tuple[WorkspaceSnapshot | None, JointVector] | None = None
        self._now = -math.inf
        self._blocked_since = math.inf
        self._waiting_since = math.inf

    @property
    def reaction_time(self) -> float:
        """T_r in use [s]."""
        return self._reaction.value

    @property
    def body(self) -> MovingBody:
        """The parts that are protected."""
        return self._gate.body

    def step(
        self,
        now: float,
        joints: JointState | None,
        snapshot: WorkspaceSnapshot | None,
        goal: JointGoal | None,
        plan: Plan | None,
    ) -> GuardDecision:
        """One tick at ``now`` [s]; never raises for what it is given."""
        began = time.perf_counter()
        verdict = self._watch.check(now, joints, snapshot)
        elapsed = min(max(now - self._now, 0.0), 0.1) if math.isfinite(self._now) else 0.0
        if math.isfinite(now):
            self._now = now
        if verdict.jumped:
            self._arm.forget()
            self._reaction.clear()
            self._reflex.approach.clear()
            self._goals.forget_times()
            self._blocked_since = self._waiting_since = math.inf
        if self._goals.set(goal):
            self._leaving = self._route is not None
            self._executed.clear()
        fresh = verdict.snapshot is not None and verdict.snapshot is not self._snapshot
        if fresh and verdict.snapshot is not None:
            self._snapshot = verdict.snapshot
            self._hazards = Hazards.of(verdict.snapshot)
        if verdict.snapshot is not None:
            self._reaction.add(now, verdict.age + self._after_decision)
        self._gate.set_reaction(self._reaction.value, self._hazards.radius)
        if verdict.joints is None or verdict.severity == Severity.BRAKE:
            return self._blind(now, verdict, joints, began)
        tick = self._look(now, elapsed, verdict, verdict.joints)
        self._executed.add(tick.here.position)
        if fresh:
            self._prove(tick)
            self._note_approach(tick)
        self._take_plan(tick, plan)
        self._decide(tick)
        tick.command = self._within_limits(tick)
        self._keep_apart(tick)
        return self._decision(tick, began)

    # -- seeing ---------------------------------------------------------------------------------

    def _look(self, now: float, elapsed: float, verdict: Verdict, joints: JointState) -> _Tick:
        """Where the arm is, where it will be, and how far hazards are from it at rest."""
        here = self._arm.ahead(joints, now)
        ahead = self._arm.ahead(joints, now + self.config.start_delay)
        still = np.zeros(self.robot.n)
        speed = max(np.abs(here.velocity).max(), np.abs(ahead.velocity).max())
        near = self._gate.at_rest(here.position, self._hazards)
        return _Tick(
            now,
            elapsed,
            verdict,
            self._snapshot,
            here,
            ahead,
            bool(speed < STANDING),
            still,
            near,
            near,
        )

    def _note_approach(self, tick: _Tick) -> None:
        """Remember how far the nearest hazard is, if it was seen.

        T2's risk asks for an obstacle's velocity. The border of unseen space has none: it jumps
        when the arm's shadow falls on another place.
        """
        nearest = int(tick.near.nearest[tick.near.closest])
        if nearest < 0 or self._unseen(nearest):
            self._reflex.approach.clear()
        else:
            self._reflex.approach.add(tick.now, tick.near.least)

    def _unseen(self, index: int) -> bool:
        """Whether a hazard, by its place in the blocks, is unseen space."""
        if self._snapshot is None:
            return False
        return bool(self._snapshot.hazard_unknown[self._hazards.blocks.order[index]])

    def _prove(self, tick: _Tick) -> None:
        """A new snapshot: is the way ahead still free?"""
        blocked = False
        for route in (self._route, self._reflex.route):
            if route is not None and tick.snapshot is not None:
                route.prove(self._model, tick.snapshot, tick.here.position)
                blocked = blocked or math.isfinite(route.blocked_at)
        if not blocked:
            self._blocked_since = math.inf
        elif math.isinf(self._blocked_since):
            self._blocked_since = tick.now

    def _take_plan(self, tick: _Tick, plan: Plan | None) -> None:
        """Take over an answer that fits, proven once more against what is known now."""
        good = self._goals.answer(tick.now, plan, tick.ahead.position)
        if good is None or good.trajectory is None or tick.snapshot is None:
            return
        route = Route(good.trajectory, good.request, good.escape_s)
        route.prove(self._model, tick.snapshot, tick.here.position)
        self._route, self._leaving = route, False
        self._blocked_since = tick.now if math.isfinite(route.blocked_at) else math.inf
        self._scale.reset(1.0)  # the motion itself begins at rest
        self._waiting_since = math.inf

    # -- deciding -------------------------------------------------------------------------------

    def _decide(self, tick: _Tick) -> None:
        """Choose what to do in this tick."""
        goals, reflex = self._goals, self._reflex
        if goals.active and tick.at_rest:
            goals.held += tick.elapsed
        if goals.active and tick.at_rest and goals.is_at(tick.here.position):
            goals.reached = True
            self._route = None
        if tick.verdict.severity == Severity.SLOW:
            self._come_to_rest(tick, GuardMode.STOPPED, tick.verdict.reason)
            return
        if reflex.active:
            self._react(tick)
            return
        if goals.active and reflex.due(tick.near.least):
            reflex.begin(tick.near.least)
            self._react(tick)
            return
        if self._leaving or not goals.active:
            self._come_to_rest(tick, GuardMode.IDLE, goals.refusal)
            if goals.refusal:
                tick.mode = GuardMode.STOPPED
            if tick.at_rest:
                self._route, self._leaving = None, False
            return
        if self._route is None:
            self._wait_for_plan(tick)
            return
        limit = 0.0 if self._waited(tick.now) else self._goal_speed()
        self._follow(tick, self._route, limit)
        self._reconsider(tick)

    def _goal_speed(self) -> float:
        goal = self._goals.goal
        return self.config.task_speed * (goal.speed if goal is not None else 1.0)

    def _wait_for_plan(self, tick: _Tick) -> None:
        """No path: hold still and ask for one."""
        tick.mode = GuardMode.PLANNING
        if self._goals.trouble:
            tick.mode, tick.reason = GuardMode.STOPPED, self._goals.trouble
        if tick.at_rest:
            tick.request = self._goals.ask(tick.now, tick.ahead.position, None)

    def _come_to_rest(self, tick: _Tick, mode: GuardMode, reason: str) -> None:
        """Slow down along the proven path if there is one, and hold."""
        route = self._reflex.route or self._route
        if route is not None and not tick.at_rest:
            self._follow(tick, route, 0.0)
        else:
            self._scale.reset()
        tick.mode, tick.reason = mode, reason

    def _follow(self, tick: _Tick, route: Route, limit: float) -> None:
        """Drive along a route, as fast as everything allows."""
        config, m = self.config, self._arm
        route.advance(self._scale.value * tick.elapsed)
        wanted = route.wanted(tick.ahead.position, LEAD * self._scale.value * config.period)
        motion = wanted.velocity + config.gain * wanted.correction
        tick.view = self._gate.judge(tick.ahead.position, motion, self._hazards)
        slowest, fastest = rate_bounds(
            self._scale.value, wanted.velocity, wanted.acceleration, m.acceleration
        )
        limit = min(limit, self._room_scale(route, wanted.velocity))
        share = tick.view.allowed
        ramp = self._scale.value + min(slowest, 0.0) * tick.elapsed
        target = share if share < max(limit, ramp) else max(limit, ramp)
        square = float(motion @ motion)
        actual = float(tick.ahead.velocity @ motion) / square if square > 1e-9 else 0.0
        tick.pace = max(min(actual, share, 1.0), 0.0)  # where it goes on after braking, if it may
        if actual > share + LAG and not tick.at_rest and square > 1e-6:
            self._brake(tick)
        else:
            scale = self._scale.towards(target, tick.elapsed, fastest)
            tick.command = scale * motion
            if not self._stop_is_free(tick) and scale > ramp:
                self._scale.reset(max(ramp, 0.0))
                tick.command = self._scale.value * motion
                tick.reason = "keeps room to stop"
        tick.scale = self._scale.value
        tick.mode = GuardMode.PREDICTIVE
        if min(share, 1.0) < limit - 1e-3:
            tick.mode = GuardMode.SLOWED if share > 1e-3 else GuardMode.STOPPED
            tick.reason = self._who(tick)
        elif math.isfinite(route.blocked_at) and limit < 0.5 * self._goal_speed():
            tick.mode = GuardMode.SLOWED
            tick.reason = "the path ahead is blocked"

    def _room_scale(self, route: Route, velocity: JointVector) -> float:
        """Greatest scale from which the arm still stops before a blocked place."""
        if math.isinf(route.blocked_at):
            return math.inf
        room = max(route.blocked_at - route.phase - STOP_ROOM, 0.0)
        fastest = np.abs(velocity) / self._arm.acceleration
        slowing = 0.7 / max(float(fastest.max()), 1e-3)
        return math.sqrt(2.0 * slowing * room)

    def _brake(self, tick: _Tick) -> None:
        """Stop as hard as the drives can; pick the route up where that leads."""
        tick.brake = True
        tick.command = np.zeros(self.robot.n)
        route = self._reflex.route or self._route
        if route is not None:
            route.rejoin(tick.ahead.position)
        self._scale.reset(tick.pace)

    def _keep_apart(self, tick: _Tick) -> None:
        """The last word on a command: brake now if braking after it could be too late."""
        if tick.brake:
            return
        held = TICKS * self.config.period
        after = self._arm.after(tick.ahead, tick.command, held)
        T_r = tick.verdict.age + held + self.config.start_delay
        if not self._gate.stops_in_time(after, T_r, self._hazards):
            self._brake(tick)
            if tick.mode == GuardMode.PREDICTIVE:
                tick.mode, tick.reason = GuardMode.SLOWED, self._who(tick)

    def _stop_is_free(self, tick: _Tick) -> bool:
        """Whether the hard stop after this command is proven free: the stop kept in hand.

        Where the arm touches something already, a speck of noise or what has come to it: whether
        the stop touches nothing more.
        """
        if tick.snapshot is None:
            return False
        after = self._arm.after(tick.ahead, tick.command, self.config.period)
        stop = self._arm.stop_path(after)
        pose = self._proof_pose(tick)
        return self._model.path_valid(stop, tick.snapshot, pose) or leaves(
            self._model, stop, tick.snapshot, pose
        )

    def _proof_pose(self, tick: _Tick) -> JointVector:
        """Where the body stood when the snapshot was first seen: one set of obstacles for all."""
        if self._proof is None or self._proof[0] is not tick.snapshot:
            self._proof = (tick.snapshot, tick.here.position.copy())
        return self._proof[1]

    def _reconsider(self, tick: _Tick) -> None:
        """Leave a path that is blocked or that the arm has left, and ask for another."""
        route = self._route
        if route is None or tick.brake:
            self._waiting_since = math.inf
            return
        if not self._waited(tick.now):
            if tick.view.allowed >= CRAWL * self._goal_speed():
                self._waiting_since = math.inf
            elif math.isinf(self._waiting_since):
                self._waiting_since = tick.now
        if not tick.at_rest:
            return
        off = float(np.abs(route.wanted(tick.ahead.position).correction).max())
        blocked = tick.now - self._blocked_since >= BLOCKED_FOR
        waited = self._waited(tick.now)
        if off > self.config.off_path or blocked or waited:
            warm = thinned(route.remaining) if not blocked else None
            self._route = None
            self._waiting_since = math.inf
            self._goals.drop_request()
            tick.request = self._goals.ask(tick.now, tick.ahead.position, warm)

    def _waited(self, now: float) -> bool:
        """Whether the arm has waited for separation so long that another way should be sought."""
        return now - self._waiting_since >= self.config.patience

    # -- reflex ---------------------------------------------------------------------------------

    def _react(self, tick: _Tick) -> None:
        """T2's reflex: come to rest, retrace or leave, hold until the danger is over."""
        reflex = self._reflex
        distance = tick.near.least
        if reflex.stage == ReflexStage.STOPPING:
            if not tick.at_rest:
                self._come_to_rest(tick, GuardMode.REFLEX, "")
            elif tick.snapshot is not None:
                self._route = None
                reflex.choose(
                    tick.here.position,
                    self._executed,
                    self._gate,
                    self._hazards,
                    self._model,
                    tick.snapshot,
                )
                self._scale.reset()
        if reflex.stage == ReflexStage.RETRACE and reflex.route is not None:
            self._follow(tick, reflex.route, 1.0)
            blocked = math.isfinite(reflex.route.blocked_at)
            if tick.at_rest and (reflex.route.done or blocked):
                reflex.hold()
        elif reflex.stage == ReflexStage.FLEE:
            self._flee(tick)
        tick.mode = GuardMode.REFLEX
        tick.reason = f"{reflex.stage.value}: {self._who(tick)}"
        stuck = reflex.stage != ReflexStage.STOPPING and reflex.stuck(tick.now, tick.at_rest)
        if reflex.over(tick.now, distance) and tick.at_rest:
            reflex.end()
        elif stuck:
            reflex.try_other(distance)
        if not reflex.active:
            self._goals.drop_request()

    def _flee(self, tick: _Tick) -> None:
        """Along the inverted vector from the nearest part, within all that separation demands."""
        near = tick.near
        if near.nearest[near.closest] < 0 or self._reflex.over(tick.now, near.least):
            return
        wanted = self._gate.away(near, tick.ahead.position, self._hazards, FLEE)
        wanted = self._gate.conform(wanted, tick.ahead.position, self._hazards)
        tick.view = self._gate.judge(tick.ahead.position, wanted, self._hazards)
        scale = self._scale.towards(min(tick.view.allowed, 1.0), tick.elapsed, math.inf)
        tick.command = scale * wanted
        tick.scale = scale
        if not self._stop_is_free(tick):
            tick.command = np.zeros(self.robot.n)
            self._scale.reset()
            if tick.at_rest:
                self._reflex.hold()

    # -- saying ---------------------------------------------------------------------------------

    def _who(self, tick: _Tick) -> str:
        """What limits the motion, in words."""
        view = tick.view
        sphere = int(np.argmin(view.share)) if np.isfinite(view.share).any() else view.closest
        index = int(view.limiting[sphere])
        if index < 0:
            index = int(view.nearest[sphere])
        if index < 0 or self._snapshot is None:
            return "nothing near"
        hazard = self._hazards.blocks.points[index]
        away = float(np.linalg.norm(hazard - view.center[sphere])) - float(
            self._gate.body.radius[sphere] + self._hazards.radius
        )
        link = self.robot.link_names[int(self._gate.body.link[sphere])]
        kind = "unseen space" if self._unseen(index) else "something"
        x, y, z = hazard
        return f"{kind} {max(away, 0.0):.2f} m from {link}, at ({x:.2f}, {y:.2f}, {z:.2f})"

    def _decision(self, tick: _Tick, began: float) -> GuardDecision:
        """Send it, and say what is done."""
        command = tick.command
        if not np.isfinite(command).all():
            command, tick.brake = np.zeros(self.robot.n), True
            tick.mode, tick.reason = GuardMode.STOPPED, "the command was not finite; report this"
        self._arm.sent(tick.now, command, tick.brake)
        goal = self._goals.goal
        view = tick.near
        pair = self._gate.body.pair(view, self._hazards, view.closest)
        route = self._reflex.route or self._route
        status = GuardStatus(
            stamp=tick.now,
            mode=tick.mode,
            reason=tick.reason,
            goal=goal.name if goal is not None else "",
            reached=self._goals.reached,
            command=command,
            speed_scale=float(tick.scale),
            distance=view.least,
            protective_distance=self._gate.protective_distance(view, tick.here, self._hazards),
            nearest_hazard=None if pair is None else pair[1],
            nearest_body=None if pair is None else pair[0],
            path=None if route is None else route.remaining,
            executed=self._executed.path,
            snapshot_sequence=-1 if tick.snapshot is None else tick.snapshot.sequence,
            snapshot_age=tick.verdict.age,
            replans=self._goals.replans,
            reflexes=self._reflex.count,
            timings=(("guard_step", time.perf_counter() - began),),
        )
        return GuardDecision(command, status, tick.request, tick.brake)

    def _within_limits(self, tick: _Tick) -> JointVector:
        """Slow the whole motion so that no joint is too fast or could not stop at its limit."""
        command = tick.command
        limits, q = self.robot.limits, tick.ahead.position
        room = np.where(command > 0.0, limits.upper - q, q - limits.lower)
        room = np.maximum(room - np.abs(tick.ahead.velocity) * self.config.period, 0.0)
        most = np.minimum(self._limits.velocity, np.sqrt(2.0 * self._arm.acceleration * room))
        excess = float((np.abs(command) / np.maximum(most, 1e-6)).max(initial=0.0))
        return command / excess if excess > 1.0 else command

    def _blind(
        self, now: float, verdict: Verdict, joints: JointState | None, began: float
    ) -> GuardDecision:
        """The arm's own state or time cannot be trusted: brake, and say why."""
        zero = np.zeros(self.robot.n)
        self._arm.sent(now if math.isfinite(now) else self._now, zero, True)
        self._scale.reset()
        self._route = None
        self._reflex.end()
        self._goals.drop_request()
        goal = self._goals.goal
        status = GuardStatus(
            stamp=now,
            mode=GuardMode.STOPPED,
            reason=verdict.reason,
            goal=goal.name if goal is not None else "",
            reached=self._goals.reached,
            command=zero,
            speed_scale=0.0,
            distance=math.inf,
            protective_distance=0.0,
            nearest_hazard=None,
            nearest_body=None,
            path=None,
            executed=self._executed.path,
            snapshot_sequence=-1 if verdict.snapshot is None else verdict.snapshot.sequence,
            snapshot_age=verdict.age,
            replans=self._goals.replans,
            reflexes=self._reflex.count,
            timings=(("guard_step", time.perf_counter() - began),),
        )
        return GuardDecision(zero, status, None, True)
