"""Velocities that a task asks for, made into commands that the arm may follow.

A wish in joint or tool space becomes joint velocities; separation lets it slide along what is near,
or slows it; a ramp brings the command there within the limits of acceleration and jerk, from the
*last command*, never from a measured velocity, so that nothing drifts; and no command is given
whose stop is not proven free. Coming to rest is the same with a wish of zero.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.motion.data import GuardMode
from armsight.motion.escape import SLACK
from armsight.motion.folding import Unfolded
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import VelocityIntent
from armsight.motion.nearest import SeparationView
from armsight.motion.ramp_kernels import ramp
from armsight.motion.route import SpeedScale
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot

END_ROOM = 0.005
"""A velocity leads no nearer to the end of a joint's travel than this [rad]."""
USED = 0.9
"""Of what separation allows this much is used: at the very limit the next look would brake."""
EXCESS = 0.05
"""An arm that closes in faster than allowed by more than this [m/s] brakes: a slower one stands."""
SINGULAR = 0.05
"""Below this smallest singular value of the Jacobian a twist is damped (design "servoing" 5.5)."""
SHRINK = 0.7
"""A wish whose stop is not free is tried again with this share of it, tick by tick."""


class Steering:
    """Drives the arm by velocities.

    Attributes:
        intent: what is wanted, or None; only a checked one.
        moving: the motion under way is one of these, and has not come to rest yet.
        scale: share of the last wish that separation and room allowed.
    """

    def __init__(self, robot: Robot, filter_: VelocityFilter, config: GuardConfig) -> None:
        self.intent: VelocityIntent | None = None
        self.moving = False
        self.scale = 1.0
        self._robot, self._filter, self._config = robot, filter_, config
        self._room = SpeedScale(config.rise, config.rise_jerk)
        self._room.reset(1.0)
        self._speed = filter_.limits.velocity * config.task_speed
        self._velocity = np.zeros(robot.n)
        self._acceleration = np.zeros(robot.n)
        limits = robot.limits
        middle = 0.5 * (limits.lower + limits.upper)
        self._lower = np.minimum(limits.lower + END_ROOM, middle)
        self._upper = np.maximum(limits.upper - END_ROOM, middle)

    def steer(self, tick: Tick) -> None:
        """One tick of the intent; towards rest once it is stale."""
        intent = self.intent
        assert intent is not None
        stale = tick.now > intent.valid_until
        wanted = np.zeros(self._robot.n)
        if not stale:
            wanted = self._joint_velocity(intent, tick.ahead.position)
        self.pursue(tick, wanted, bound=intent.bound)
        if tick.mode == GuardMode.PREDICTIVE:
            tick.mode = GuardMode.VELOCITY
        if stale:
            late = tick.now - intent.valid_until
            tick.mode = GuardMode.STOPPED
            tick.reason = f"velocity {intent.name} is stale: it ended {late:.2f} s ago"

    def pursue(
        self,
        tick: Tick,
        wanted: JointVector,
        rubs: float = SLACK,
        bound: bool = False,
        at_once: bool = False,
    ) -> None:
        """One tick towards (n,) joint velocities [rad/s], as far as everything allows.

        ``rubs``: as in :meth:`.VelocityFilter.stop_is_free` [m]; ``bound``: as of a
        :class:`VelocityIntent`; ``at_once``: as the drives can, whatever the jerk.
        """
        self.moving = True
        wanted = wanted / max(float((np.abs(wanted) / self._speed).max()), 1.0)
        led = Unfolded(wanted) if bound else self._filter.unfold(tick, wanted)
        if led.links is not None:
            tick.reason = "{} is in the way of {}".format(*led.links)
        eased = self._filter.ease(tick, led.motion)
        view = tick.view = self._filter.judge(tick, eased)
        target = eased
        if view.allowed < 1.0:
            target = self._aside(tick, eased, view, bound)
        self._command(tick, target * self._room.value, bound, at_once)
        self._keep_room(tick, rubs)
        self._say(tick, wanted, view.allowed)

    def halt(self, tick: Tick) -> None:
        """One tick on the way to rest, whatever the intent: the smooth stop."""
        tick.view = tick.near
        self._command(tick, np.zeros(self._robot.n))
        self._keep_room(tick)

    def sent(self, tick: Tick) -> None:
        """What was commanded in this tick, by whomever: the next ramp goes on from there."""
        if tick.brake:
            self._velocity, self._acceleration = (
                tick.ahead.velocity.copy(),
                np.zeros(len(tick.command)),
            )
        else:
            before = self._velocity
            self._velocity = tick.command.copy()
            if tick.elapsed > 1e-6:
                most = self._filter.limits.acceleration
                rate = (self._velocity - before) / tick.elapsed
                self._acceleration = np.clip(rate, -most, most)
        if tick.at_rest and not self._velocity.any():
            self.moving = False

    @property
    def acceleration(self) -> JointVector:
        """(n,) of the motion under way, as commanded [rad/s^2]."""
        return self._acceleration

    def forget(self) -> None:
        """The arm was stopped from outside of this: begin anew from rest."""
        self._velocity = np.zeros(self._robot.n)
        self._acceleration = np.zeros(self._robot.n)
        self._room.reset(1.0)
        self.moving = False

    def _joint_velocity(self, intent: VelocityIntent, q: JointVector) -> JointVector:
        """(n,) joint velocities of a wish [rad/s]."""
        velocity = np.asarray(intent.velocity, float)
        if intent.frame == "joint":
            return velocity.copy()
        if intent.frame == "tcp":
            R = tcp_pose(self._robot, q)[:3, :3]
            velocity = np.concatenate([R @ velocity[:3], R @ velocity[3:]])
        return joints_of_twist(tcp_jacobian(self._robot, q), velocity)

    def _aside(
        self, tick: Tick, wanted: JointVector, view: SeparationView, bound: bool
    ) -> JointVector:
        """What is allowed of a motion that closes in on something: along it, or less of it."""
        if bound:
            return _share(view) * wanted
        motion, tick.view = self._filter.slide(tick, wanted, view)
        return _share(tick.view) * motion

    def _command(
        self, tick: Tick, target: JointVector, bound: bool = False, at_once: bool = False
    ) -> None:
        """The next velocity on the way to a target, and no faster than separation allows."""
        limits = self._filter.limits
        jerk = limits.acceleration / self._config.period if at_once else limits.jerk
        tick.command = ramp(
            np.ascontiguousarray(target), tick.ahead.position, self._velocity, self._acceleration,
            self._lower, self._upper, self._speed, limits.acceleration, jerk,
            max(tick.elapsed, 1e-4), self._config.period,
        )  # fmt: skip
        tick.command = self._filter.ease(tick, tick.command)
        view = self._filter.judge(tick, tick.command)
        if view.allowed >= 1.0:
            return
        # The ramp lags behind what slides along: here separation outranks the limit of jerk.
        tick.command = self._aside(tick, tick.command, view, bound)
        if self._filter.excess(tick, tick.ahead.velocity) > EXCESS:
            tick.stop_hard()

    def _keep_room(self, tick: Tick, rubs: float = SLACK) -> None:
        """Go on only where the stop that follows is proven free; else slow down, else brake."""
        if tick.brake:
            return
        if self._filter.stop_is_free(tick, rubs):
            if self._room.towards(1.0, tick.elapsed, np.inf) < 0.98:
                tick.reason = "keeps room to stop"
            return
        self._room.reset(SHRINK * self._room.value if self._room.value > 0.02 else 0.0)
        tick.reason = "keeps room to stop"
        change = self._filter.limits.acceleration * tick.elapsed
        tick.command = self._velocity - np.clip(self._velocity, -change, change)
        if not self._filter.stop_is_free(tick, rubs) and not tick.at_rest:
            tick.stop_hard()

    def _say(self, tick: Tick, wanted: JointVector, allowed: float) -> None:
        """What is done, and why not all that was wanted."""
        square = float(wanted @ wanted)
        tick.scale = float(np.clip(tick.command @ wanted / square, 0.0, 1.0)) if square else 0.0
        tick.wanted, self.scale = wanted, min(max(allowed, 0.0), 1.0) * self._room.value
        if allowed < 1.0:
            tick.reason = self._filter.who(tick.view)
        elif not tick.reason:
            tick.reason = self._end_of_travel(tick, wanted)
        tick.mode = GuardMode.PREDICTIVE
        if tick.reason:
            tick.mode = GuardMode.SLOWED if tick.scale > 1e-3 else GuardMode.STOPPED

    def _end_of_travel(self, tick: Tick, wanted: JointVector) -> str:
        """Names the joint that cannot go on, if one wants to."""
        q = tick.ahead.position
        room = np.where(wanted > 0.0, self._upper - q, q - self._lower)
        held = (np.abs(wanted) > 1e-3) & (np.abs(tick.command) < 0.5 * np.abs(wanted))
        held &= room < np.maximum(wanted**2 / self._filter.limits.acceleration, 0.02)
        if not held.any():
            return ""
        return f"{self._robot.joint_names[int(np.argmax(held))]} is at the end of its travel"


def _share(view: SeparationView) -> float:
    """Share of a motion to use, by what separation says of it."""
    return 1.0 if view.allowed >= 1.0 else USED * view.allowed


def joints_of_twist(J: Floats, twist: Floats) -> JointVector:
    """(n,) joint velocities [rad/s] that move the TCP with a (6,) twist, damped near singularities.

    Damped least squares, ``q' = J^T (J J^T + mu^2)^-1 v`` with mu^2 = 0.05^2 (1 - (s / 0.05)^2)
    where the smallest singular value s is below 0.05 (Chiaverini 1997): near a singularity the arm
    lags behind the wish instead of racing, and never stops for that alone.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    damping = 0.0
    if s[-1] < SINGULAR:
        damping = SINGULAR**2 * (1.0 - (s[-1] / SINGULAR) ** 2)
    gain = s / (s * s + damping)
    return np.asarray(Vt.T @ (gain * (U.T @ twist)))
