"""The one door to the arm: every motion of every task passes here, and nobody is touched.

Each tick (docs/guard.md): judge the input, follow the planned path or react, let
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
from dataclasses import replace

import numpy as np

from armsight.devices.data import JointState, RgbdCameraInfo, Wrench
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import ArmState
from armsight.motion.collision import CollisionModel
from armsight.motion.data import GuardMode
from armsight.motion.evasion import Evasion
from armsight.motion.executed import Executed, thinned
from armsight.motion.faults import FaultWatch, Severity, Verdict
from armsight.motion.following import RouteFollower
from armsight.motion.goals import Goals
from armsight.motion.gone_in import GoneIn
from armsight.motion.guard_config import GuardConfig
from armsight.motion.handover import coast, joined
from armsight.motion.intents import Intent
from armsight.motion.looking import look, note_approach
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_office import PermitOffice
from armsight.motion.plan import Plan
from armsight.motion.reflex import Reflex, ReflexStage
from armsight.motion.route import Route
from armsight.motion.status_writer import StatusWriter
from armsight.motion.steering import Steering
from armsight.motion.tick import GuardDecision, Tick
from armsight.motion.velocity_filter import VelocityFilter
from armsight.motion.wishes import Wishes
from armsight.robots.robot import Robot

CRAWL = 0.1
"""An arm that separation lets go on at less than this share of the planned speed is waiting."""
BLOCKED_FOR = 0.1
"""A path must be blocked for this long before another is asked for [s]: noise flickers."""


class Guard:
    """Guards one arm. Knows no thread and no clock: time comes in.

    Args:
        robot: the arm with its tool; needs link spheres.
        cameras: whose pictures must be fresh.
        config: settings.
        model: collision checks; made for the robot if left out.

    Raises:
        ValueError: the robot has no spheres, so nothing of it could be protected.
    """

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        config: GuardConfig | None = None,
        model: CollisionModel | None = None,
    ) -> None:
        self.config = config = config or GuardConfig()
        self.robot = robot
        self._model = model or CollisionModel(robot)
        self._filter = VelocityFilter(robot, cameras, config, self._model)
        self._follower = RouteFollower(self._filter, config)
        self._steering = Steering(robot, self._filter, config)
        self._watch = FaultWatch(robot, cameras, config)
        self._goals = Goals(robot, config)
        self._wishes = Wishes(robot, self._goals, self._steering)
        self._reflex = Reflex(config, robot.limits.scaled(*config.planned))
        self._executed = Executed()
        self._gone_in = GoneIn()
        self._evasion = Evasion(
            self._reflex, self._filter, self._follower, self._steering, self._executed
        )
        self._permits = PermitOffice(robot, self._filter.monitor.body, config, self._executed)
        self._writer = StatusWriter(
            self._filter, self._goals, self._wishes, self._executed, self._reflex, self._permits
        )
        self._route: Route | None = None
        self._leaving = False
        self._coasting = self._joining = False
        self._mapped: WorkspaceSnapshot | None = None
        self._snapshot: WorkspaceSnapshot | None = None
        self._now = -math.inf
        self._blocked_since = math.inf
        self._waiting_since = math.inf

    @property
    def body(self) -> MovingBody:
        """The parts that are protected."""
        return self._filter.monitor.body

    def feel(self, readings: Sequence[Wrench]) -> None:
        """Every reading of the force sensor since the last tick, oldest first."""
        self._permits.feel(readings)
        self._filter.monitor.feel(readings)

    def step(
        self,
        now: float,
        joints: JointState | None,
        snapshot: WorkspaceSnapshot | None,
        intent: Intent | None,
        plan: Plan | None,
    ) -> GuardDecision:
        """One tick at ``now`` [s]; never raises for what it is given."""
        began = time.perf_counter()
        verdict = self._watch.check(now, joints, snapshot)
        elapsed = min(max(now - self._now, 0.0), 0.1) if math.isfinite(self._now) else 0.0
        if math.isfinite(now):
            self._now = now
        if verdict.jumped:
            self._filter.forget_times()
            self._permits.forget_times(now)
            self._reflex.approach.clear()
            self._gone_in.forget()
            self._goals.forget_times()
            self._blocked_since = self._waiting_since = math.inf
        if self._wishes.take(now, intent):
            self._leaving = self._route is not None
            self._executed.clear()
        fresh = self._see(now, intent, verdict)
        self._filter.measure(now, verdict.age, well=verdict.severity == Severity.NONE)
        if verdict.joints is None or verdict.severity == Severity.BRAKE:
            return self._blind(now, verdict, began)
        tick = look(self._filter, now, elapsed, verdict, verdict.joints, self._snapshot)
        self._executed.add(tick.here.position)
        if fresh:
            self._prove(tick)
            note_approach(tick, self._filter, self._reflex.approach)
            self._gone_in.see(tick, self._filter, self._permits.grant)
        self._take_plan(tick, plan)
        self._decide(tick)
        tick.command = self._filter.within_limits(tick)
        tick.command = self._filter.followed(tick)
        self._keep_apart(tick)
        return self._decision(tick, began)

    # -- seeing ---------------------------------------------------------------------------------

    def _see(self, now: float, intent: Intent | None, verdict: Verdict) -> bool:
        """Take in the newest map as what may be touched lets it count; whether it is another."""
        seen = verdict.snapshot
        q = None if verdict.joints is None else np.asarray(verdict.joints.position, float)
        permit = getattr(intent, "permit", None)
        changed = self._permits.consider(now, permit, seen, verdict.joints, self._filter.arm.told)
        fresh = seen is not None and (seen is not self._mapped or changed)
        if seen is not None and fresh:
            self._mapped, self._snapshot = seen, self._permits.apply(seen)
            self._filter.see(self._snapshot)
        when = now + self.config.start_delay
        self._filter.monitor.contact = self._permits.law(when, q, self._snapshot)
        return fresh

    def _prove(self, tick: Tick) -> None:
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

    def _take_plan(self, tick: Tick, plan: Plan | None) -> None:
        """Take over an answer that fits, proven once more against what is known now."""
        coasting = self._route if self._coasting and self._route is not None else None
        begins = tick.ahead.position if coasting is None else coasting.trajectory.end
        good = self._goals.answer(tick.now, plan, begins)
        if good is None or good.trajectory is None or tick.snapshot is None:
            return
        self._joining = coasting is not None and not tick.at_rest and good.escape_s == 0.0
        self._follower.scale.reset(1.0)  # the motion itself begins at rest
        route = Route(good.trajectory, good.request, good.escape_s)
        route.prove(self._model, tick.snapshot, tick.here.position)
        self._route, self._leaving, self._coasting = route, False, False
        self._blocked_since = tick.now if math.isfinite(route.blocked_at) else math.inf
        self._waiting_since = math.inf

    # -- deciding -------------------------------------------------------------------------------

    def _decide(self, tick: Tick) -> None:
        """Choose what to do in this tick."""
        goals, reflex, steering = self._goals, self._reflex, self._steering
        if goals.active and tick.at_rest:
            goals.held += tick.elapsed
        if goals.active and tick.at_rest and goals.is_at(tick.here.position):
            goals.reached = True
            self._route = None
        retreat = self._permits.retreat
        if tick.verdict.severity == Severity.SLOW and not self._permits.leaves:
            self._come_to_rest(tick, GuardMode.STOPPED, tick.verdict.reason)
            return
        if retreat is not None:
            self._route, self._joining, self._coasting = None, False, False
            if retreat.stands is not None:
                reflex.end()
                self._come_to_rest(tick, GuardMode.STOPPED, f"stands, held: {retreat.reason}")
            else:
                self._evasion.back_out(tick, retreat, self._permits.push)
            self._goals.drop_request()
            return
        if tick.now < self._gone_in.until:
            self._come_to_rest(tick, GuardMode.STOPPED, "stands until who ran in may be out again")
            return
        if reflex.active:
            self._react(tick)
            return
        if reflex.due(tick.near.least) and self._permits.in_contact(tick.now):
            if self._permits.one_way_out:  # what a socket holds stands still
                self._come_to_rest(tick, GuardMode.STOPPED, self._filter.who(tick.view))
                return
            self._permits.withdraw("something else is too near", tick.now)
        if (goals.active or steering.intent is not None) and reflex.due(tick.near.least):
            reflex.begin(tick.near.least)
            self._react(tick)
            return
        if steering.intent is not None:
            self._route, self._leaving, self._coasting = None, False, False
            steering.steer(tick)
            return
        if self._leaving or not goals.active:
            rest = self._wishes.rest
            self._come_to_rest(tick, GuardMode.IDLE, goals.refusal or rest.reason)
            if goals.refusal or rest.fault:
                tick.mode = GuardMode.STOPPED
            if tick.at_rest:
                self._route, self._leaving, self._coasting = None, False, False
            return
        if self._coasting and tick.at_rest and not goals.waiting:
            self._route, self._coasting = None, False
        if self._route is None:
            self._wait_for_plan(tick)
            return
        if self._joining:
            self._join(tick, self._route)
            return
        limit = 0.0 if self._waited(tick.now) else self._goal_speed()
        self._follower.follow(tick, self._route, limit, self._goal_speed())
        self._reconsider(tick)

    def _goal_speed(self) -> float:
        goal = self._goals.goal
        return self.config.task_speed * (goal.speed if goal is not None else 1.0)

    def _wait_for_plan(self, tick: Tick) -> None:
        """No path: hold still and ask for one; or coast, and ask for one from where that ends."""
        if self._steering.moving and not tick.at_rest:
            if self._coast(tick):
                return
            self._steering.halt(tick)
        tick.mode = GuardMode.PLANNING
        if self._goals.trouble:
            tick.mode, tick.reason = GuardMode.STOPPED, self._goals.trouble
        if tick.at_rest:
            tick.request = self._goals.ask(tick.now, tick.ahead.position, None)

    def _coast(self, tick: Tick) -> bool:
        """Go on from a velocity towards rest, and have a plan made that begins on the way."""
        if tick.snapshot is None:
            return False
        before = ArmState(
            tick.ahead.time,
            tick.ahead.position - tick.elapsed * tick.ahead.velocity,
            tick.ahead.velocity,
        )  # following goes on by one tick
        acceleration, limits = self._steering.acceleration, self._filter.limits
        motion = coast(self._model, tick.snapshot, before, acceleration, limits)
        if motion is None:
            return False
        request = self._goals.ask(tick.now, motion.end, None)
        if request is None:
            return False
        self._route, self._coasting = Route(motion), True
        self._follower.scale.reset(1.0)
        self._follower.follow(tick, self._route, 1.0, 1.0)
        tick.request, tick.mode = request, GuardMode.PLANNING
        return True

    def _join(self, tick: Tick, route: Route) -> None:
        """Still moving from a velocity: come onto the route, which begins at rest."""
        speed = self._goal_speed()
        route.advance(speed * self._steering.scale * tick.elapsed)
        wanted = route.wanted(tick.ahead.position, speed * self.config.period)
        motion = speed * wanted.velocity + self.config.gain * wanted.correction
        # A ramp that has to let go of its acceleration in time lags behind by this much.
        pull = speed * speed * wanted.acceleration
        lag = pull * np.abs(pull) / (2.0 * self._filter.limits.jerk)
        self._steering.pursue(tick, motion + lag)
        most = self._filter.limits.acceleration * self.config.period
        if joined(tick, route, motion, most):
            self._joining = False
            self._follower.scale.reset(speed)

    def _come_to_rest(self, tick: Tick, mode: GuardMode, reason: str) -> None:
        """Slow down along the proven path if there is one, and hold."""
        if self._joining:  # not on its path yet: it comes to rest as a velocity does
            self._route, self._joining = None, False
        route = self._reflex.route or self._route
        if route is not None and not tick.at_rest:
            self._follower.follow(tick, route, 0.0, self._goal_speed())
        else:
            self._follower.scale.reset()
            if self._steering.moving and not tick.at_rest:
                self._steering.halt(tick)
        tick.mode, tick.reason = mode, reason

    def _brake(self, tick: Tick) -> None:
        """Stop as hard as the drives can; pick the route up where that leads."""
        self._follower.brake(tick, self._reflex.route or self._route)

    def _keep_apart(self, tick: Tick) -> None:
        """The last word on a command: brake now if braking after it could be too late."""
        if tick.brake or self._filter.stops_in_time(tick, self._permits.leaves):
            return
        self._brake(tick)
        if tick.mode in (GuardMode.PREDICTIVE, GuardMode.VELOCITY):
            tick.mode, tick.reason = GuardMode.SLOWED, self._filter.who(tick.view)

    def _reconsider(self, tick: Tick) -> None:
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

    def _react(self, tick: Tick) -> None:
        """T2's reflex, until the danger is over."""
        if self._reflex.stage == ReflexStage.STOPPING and not tick.at_rest:
            self._come_to_rest(tick, GuardMode.REFLEX, "")
        elif self._evasion.begin(tick):
            self._route = None
        self._evasion.react(tick, self._goal_speed())
        if not self._reflex.active:
            self._goals.drop_request()

    # -- saying ---------------------------------------------------------------------------------

    def _decision(self, tick: Tick, began: float) -> GuardDecision:
        """Send it, and say what is done."""
        if not np.isfinite(tick.command).all():
            tick.stop_hard()
            tick.mode, tick.reason = GuardMode.STOPPED, "the command was not finite; report this"
        self._filter.arm.sent(tick.now, tick.command, tick.brake)
        self._watch.sent(tick.now, tick.command, tick.brake)
        self._steering.sent(tick)
        status = self._writer.of(tick, self._reflex.route or self._route, began)
        request = tick.request
        if request is not None:
            request = replace(request, grant=self._permits.grant)
        return GuardDecision(tick.command, status, request, tick.brake)

    def _blind(self, now: float, verdict: Verdict, began: float) -> GuardDecision:
        """The arm's own state or time cannot be trusted: brake, and say why."""
        zero = np.zeros(self.robot.n)
        at = now if math.isfinite(now) else self._now
        self._filter.arm.sent(at, zero, True)
        self._watch.sent(at, zero, True)
        self._follower.scale.reset()
        self._steering.forget()
        self._route = None
        self._reflex.end()
        self._goals.drop_request()
        return GuardDecision(zero, self._writer.blind(now, verdict, began), None, True)
