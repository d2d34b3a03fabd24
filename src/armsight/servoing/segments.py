"""V's planner: segments that go a part of the way to the target, the next planned while one runs.

``y* = y(t0) + alpha (s - y(t0))`` with alpha 0.8, and 1.0 below 2 cm (eq. 1), the joints by eq. 2
(:func:`.aim.joints_for`), y* held in the workcell's box, the tool towards the side where the person
stands. Segment k + 1 is planned from the expected end of k with what the sensors say when k begins,
and begins when both are done; each comes to rest, as V's arm did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, JointVector, Vector3
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.aim import Aim, Weights, joints_for
from armsight.servoing.approach import facing


@dataclass(frozen=True)
class SegmentConfig:
    """Settings of :class:`SegmentPlanner`.

    Attributes:
        alpha: share of the way to the target that a segment goes (V: 0.8); near: within this
            distance all of it [m] (V: 2 cm).
        planning: what planning a segment takes [s] (V: about 30 ms).
        least: shortest segment [s] (V: about 300 ms).
        lower, upper: the workcell's box in ``base``, in which the goal is held [m].
        speed, acceleration: shares of the joints' limits that the cell allows.
    """

    alpha: float = 0.8
    near: float = 0.02
    planning: float = 0.03
    least: float = 0.3
    lower: tuple[float, float, float] = (-math.inf, -math.inf, -math.inf)
    upper: tuple[float, float, float] = (math.inf, math.inf, math.inf)
    speed: float = 0.5
    acceleration: float = 0.6


@dataclass(frozen=True)
class Segment:
    """A motion from rest to rest: (n,) joints at its ends [rad], its beginning and length [s]."""

    start: JointVector
    end: JointVector
    begin: float
    seconds: float

    def at(self, time: float) -> tuple[JointVector, JointVector, JointVector]:
        """Waypoint at a time: q [rad], q' [rad/s], q'' [rad/s^2], by a quintic."""
        s = min(max((time - self.begin) / self.seconds, 0.0), 1.0)
        way, T = self.end - self.start, self.seconds
        q = self.start + way * (s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        v = way * (30.0 * s * s * (1.0 - s) ** 2) / T
        a = way * (60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)) / T**2
        return q, v, a


@dataclass
class SegmentPlanner:
    """Plans segment after segment towards what the Master says.

    Attributes:
        iterations: segments begun.
        downward: the tool points down, the pair looking down with it (V's hand).
    """

    robot: Robot
    config: SegmentConfig
    vertical: Vector3
    front: Vector3
    down: Vector3
    weights: Weights = field(default_factory=Weights)
    iterations: int = 0
    running: Segment | None = None
    downward: bool = False
    _next: tuple[float, JointVector] | None = None
    _axis: Vector3 | None = None

    def reset(self) -> None:
        """Begin anew from rest."""
        self.iterations, self.running, self._next, self._axis = 0, None, None, None

    def waypoint(
        self, now: float, here: JointVector, target: Vector3 | None
    ) -> tuple[JointVector, JointVector]:
        """Joints [rad] and their velocities [rad/s] wanted at ``now``.

        Args:
            now: the time that the waypoint is for [s].
            here: (n,) joints where nothing runs yet [rad].
            target: (3,) where the Master says that the target is [m], or None: no new segment.
        """
        running = self.running
        ended = running is None or now >= running.begin + running.seconds
        if self._next is None and target is not None:
            begin = here if running is None else running.end
            self._next = (now + self.config.planning, self._plan(begin, target))
        if ended and self._next is not None and now >= self._next[0]:
            start = here if running is None else running.end
            self.running = Segment(start, self._next[1], now, self._seconds(start, self._next[1]))
            self.iterations += 1
            self._next = None
        if self.running is None:
            return here, np.zeros(self.robot.n)
        q, v, _ = self.running.at(now)
        return q, v

    def delay(self, seconds: float) -> None:
        """The arm was held up: what runs goes on that much later."""
        if self.running is not None:
            r = self.running
            self.running = Segment(r.start, r.end, r.begin + seconds, r.seconds)

    def _plan(self, start: JointVector, target: Vector3) -> JointVector:
        """(n,) joints at the end of the next segment."""
        y = tcp_pose(self.robot, start)[:3, 3]
        away = target - y
        near = float(np.linalg.norm(away)) < self.config.near
        goal = y + (1.0 if near else self.config.alpha) * away
        goal = np.clip(goal, self.config.lower, self.config.upper)
        flat = away - self.vertical * (self.vertical @ away)
        if self._axis is None or np.linalg.norm(flat) > self.config.near:
            self._axis = facing(away, self.vertical, self.front)
        axis, down = self._axis, self.down
        if self.downward:
            axis, down = -self.vertical, -axis
        aim = Aim(goal, np.zeros(3), axis, down)
        return joints_for(self.robot, aim, start, self.weights, rounds=30)

    def _seconds(self, start: JointVector, end: JointVector) -> float:
        """How long a quintic from rest to rest takes within the limits."""
        way: Floats = np.abs(end - start)
        limits = self.robot.limits.scaled(self.config.speed, self.config.acceleration)
        fast = float((1.875 * way / limits.velocity).max())
        hard = float(np.sqrt(5.7735 * way / limits.acceleration).max())
        return max(self.config.least, fast, hard)
