"""Joint motions in time: pieces of constant jerk, so that every limit can be read off exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector
from armsight.robots.robot import JointLimits


@dataclass(frozen=True)
class Trajectory:
    """A motion of n joints in k pieces of constant jerk, at rest before and after it.

    A guard plays it by its own phase time, faster or slower; before 0 and after ``duration`` the
    ends are held.

    Attributes:
        times: (k + 1,) where pieces begin, from 0 on, and the end [s].
        q, qd, qdd: (k + 1, n) position [rad], velocity [rad/s], acceleration [rad/s^2] there.
        jerk: (k, n) of each piece [rad/s^3].
    """

    times: Floats
    q: JointPath
    qd: JointPath
    qdd: JointPath
    jerk: JointPath

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return float(self.times[-1])

    @property
    def start(self) -> JointVector:
        """(n,) where it begins [rad]."""
        return self.q[0]

    @property
    def end(self) -> JointVector:
        """(n,) where it ends [rad]."""
        return self.q[-1]

    def position(self, t: float) -> JointVector:
        """(n,) [rad] at t [s]."""
        k, dt = self._piece(t)
        if k >= len(self.jerk):
            return self.q[-1].copy()
        return np.asarray(
            self.q[k] + dt * (self.qd[k] + dt * (self.qdd[k] / 2.0 + dt * self.jerk[k] / 6.0))
        )

    def velocity(self, t: float) -> JointVector:
        """(n,) [rad/s] at t [s]."""
        k, dt = self._piece(t)
        if k >= len(self.jerk):
            return self.qd[-1].copy()
        return np.asarray(self.qd[k] + dt * (self.qdd[k] + dt * self.jerk[k] / 2.0))

    def acceleration(self, t: float) -> JointVector:
        """(n,) [rad/s^2] at t [s]."""
        k, dt = self._piece(t)
        if k >= len(self.jerk):
            return self.qdd[-1].copy()
        return np.asarray(self.qdd[k] + dt * self.jerk[k])

    def sample(self, times: Floats) -> JointPath:
        """(len(times), n) positions [rad]."""
        t = np.clip(np.asarray(times, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, max(len(self.jerk) - 1, 0))
        if len(self.jerk) == 0:
            return np.repeat(self.q[:1], len(t), axis=0)
        dt = (t - self.times[k])[:, None]
        return np.asarray(
            self.q[k] + dt * (self.qd[k] + dt * (self.qdd[k] / 2.0 + dt * self.jerk[k] / 6.0))
        )

    def peak(self) -> tuple[JointVector, JointVector, JointVector]:
        """(n,) greatest |velocity|, |acceleration| and |jerk| reached anywhere, exactly."""
        speed = np.abs(self.qd).max(axis=0)
        if len(self.jerk) == 0:
            return speed, np.abs(self.qdd).max(axis=0), np.zeros(self.n)
        # Between the ends of a piece the speed is greatest where the acceleration is zero.
        a, b = self.qdd[:-1], self.qdd[1:]
        turns = a * b < 0.0
        between = np.where(turns, self.qd[:-1] - a * a / np.where(turns, 2.0 * self.jerk, 1.0), 0.0)
        return (
            np.maximum(speed, np.abs(between).max(axis=0)),
            np.abs(self.qdd).max(axis=0),
            np.abs(self.jerk).max(axis=0),
        )

    def slowed(self, factor: float) -> Trajectory:
        """The same motion, ``factor`` times as long."""
        f = factor
        return Trajectory(self.times * f, self.q, self.qd / f, self.qdd / f**2, self.jerk / f**3)

    def _piece(self, t: float) -> tuple[int, float]:
        """Piece and time into it; (number of pieces, 0) from the end on."""
        if t >= self.times[-1]:
            return len(self.jerk), 0.0
        k = max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)
        return k, max(t - float(self.times[k]), 0.0)


def hold(q: JointVector) -> Trajectory:
    """Standing still at (n,) [rad]: a trajectory of no duration."""
    q = np.array(q, float)[None]
    return Trajectory(np.zeros(1), q, np.zeros_like(q), np.zeros_like(q), np.zeros((0, q.shape[1])))


def from_jerks(
    durations: Floats, jerk: JointPath, q: JointVector, qd: JointVector, qdd: JointVector
) -> Trajectory:
    """Integrate (k,) durations [s] of (k, n) constant jerks from a state."""
    keep = np.asarray(durations) > 1e-12
    d, j = np.asarray(durations, float)[keep], np.asarray(jerk, float)[keep]
    k, n = j.shape[0], len(q)
    out_q, out_v, out_a = (np.empty((k + 1, n)) for _ in range(3))
    out_q[0], out_v[0], out_a[0] = q, qd, qdd
    for i in range(k):
        dt = d[i]
        out_q[i + 1] = out_q[i] + dt * (out_v[i] + dt * (out_a[i] / 2.0 + dt * j[i] / 6.0))
        out_v[i + 1] = out_v[i] + dt * (out_a[i] + dt * j[i] / 2.0)
        out_a[i + 1] = out_a[i] + dt * j[i]
    return Trajectory(np.concatenate([[0.0], np.cumsum(d)]), out_q, out_v, out_a, j)


def join(parts: Sequence[Trajectory]) -> Trajectory:
    """One after the other; each begins where the one before it ends, at rest."""
    parts = [p for p in parts if len(p.jerk)] or list(parts[:1])
    offset = np.cumsum([0.0] + [p.duration for p in parts])
    return Trajectory(
        np.concatenate([p.times[:-1] + o for p, o in zip(parts, offset)] + [offset[-1:]]),
        np.concatenate([p.q[:-1] for p in parts] + [parts[-1].q[-1:]]),
        np.concatenate([p.qd[:-1] for p in parts] + [parts[-1].qd[-1:]]),
        np.concatenate([p.qdd[:-1] for p in parts] + [parts[-1].qdd[-1:]]),
        np.concatenate([p.jerk for p in parts]),
    )


def straight(q0: JointVector, q1: JointVector, limits: JointLimits) -> Trajectory:
    """The fastest motion along the straight joint line from rest to rest, within all limits."""
    q0, q1 = np.asarray(q0, float), np.asarray(q1, float)
    d = q1 - q0
    moving = np.abs(d) > 1e-12
    if not moving.any():
        return hold(q0)
    size = np.abs(d[moving])
    v = float((limits.velocity[moving] / size).min())
    a = float((limits.acceleration[moving] / size).min())
    j = float((limits.jerk[moving] / size).min())
    t = double_s(1.0, v, a, j)
    signs = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    zero = np.zeros_like(q0)
    motion = from_jerks(t, signs[:, None] * j * d, q0, zero, zero)
    return _ending_at(motion, q1)


def double_s(length: float, v: float, a: float, j: float) -> Floats:
    """(7,) durations [s] of the fastest rest-to-rest motion over a length: jerk +, 0, -, cruise ...

    The classical double-S law (Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines
    and Robots, 3.4) for zero end velocities.
    """
    if v * j >= a * a:
        ramp, rise = a / j, a / j + v / a
    else:
        ramp = np.sqrt(v / j)
        rise = 2.0 * ramp
    cruise = length / v - rise
    if cruise < 0.0:
        cruise = 0.0
        ramp = a / j
        rise = 0.5 * ramp + np.sqrt(0.25 * ramp * ramp + length / a)
        if rise < 2.0 * ramp:
            ramp = (length / (2.0 * j)) ** (1.0 / 3.0)
            rise = 2.0 * ramp
    flat = max(rise - 2.0 * ramp, 0.0)
    return np.array([ramp, flat, ramp, cruise, ramp, flat, ramp])


def stop_trajectory(
    q: JointVector, qd: JointVector, limits: JointLimits, qdd: JointVector | None = None
) -> Trajectory:
    """Brake every joint to rest as fast as its acceleration and jerk limits allow.

    Args:
        q: (n,) present position [rad].
        qd: (n,) present velocity [rad/s].
        limits: of the joints; velocity and position limits are not needed.
        qdd: (n,) present acceleration [rad/s^2], zero when not given; clipped to its limit.
    """
    q, qd = np.asarray(q, float), np.asarray(qd, float)
    a0 = np.zeros_like(q) if qdd is None else np.asarray(qdd, float)
    a0 = np.clip(a0, -limits.acceleration, limits.acceleration)
    phases = [_brake(*x) for x in zip(qd, a0, limits.acceleration, limits.jerk)]
    return _to_rest(phases, q, qd, a0)


def coasting(
    q: JointVector, qd: JointVector, qdd: JointVector, hold: float, limits: JointLimits
) -> Trajectory:
    """Let go of the acceleration, go on for a time, then brake every joint to rest.

    Args:
        q: (n,) present position [rad].
        qd: (n,) present velocity [rad/s].
        qdd: (n,) present acceleration [rad/s^2]; clipped to its limit.
        hold: how long the velocity is held [s].
        limits: of the joints; velocity and position limits are not needed.
    """
    q, qd = np.asarray(q, float), np.asarray(qd, float)
    a0 = np.clip(np.asarray(qdd, float), -limits.acceleration, limits.acceleration)
    phases = []
    for v, a, most, jerk in zip(qd, a0, limits.acceleration, limits.jerk):
        ease = abs(a) / jerk
        times, jerks = _brake(v + 0.5 * a * ease, 0.0, most, jerk)
        phases.append(
            (
                np.concatenate([[ease, hold], times]),
                np.concatenate([[-np.sign(a) * jerk, 0.0], jerks]),
            )
        )
    return _to_rest(phases, q, qd, a0)


def _to_rest(
    phases: Sequence[tuple[Floats, Floats]], q: JointVector, qd: JointVector, a0: JointVector
) -> Trajectory:
    """The motion of joints that each have (durations, jerks) of their own, ending at rest."""
    ends = np.unique(np.concatenate([np.cumsum(t) for t, _ in phases]))
    ends = ends[ends > 1e-12]
    if len(ends) == 0:
        return hold(q)
    middle = ends - 0.5 * np.diff(ends, prepend=0.0)
    jerk = np.zeros((len(ends), len(q)))
    for i, (t, j) in enumerate(phases):
        phase = np.searchsorted(np.cumsum(t), middle)
        jerk[:, i] = np.append(j, 0.0)[phase]
    motion = from_jerks(np.diff(ends, prepend=0.0), jerk, q, qd, a0)
    motion.qd[-1] = 0.0
    motion.qdd[-1] = 0.0
    return motion


def _brake(v: float, a0: float, a: float, j: float) -> tuple[Floats, Floats]:
    """Durations and jerks of three phases that bring (v, a0) to rest in least time."""
    if v == 0.0 and a0 == 0.0:
        return np.zeros(3), np.zeros(3)
    # The velocity left if the acceleration were let go at once says which way to push.
    left = v + a0 * abs(a0) / (2.0 * j)
    way = -1.0 if left > 0.0 else 1.0
    start, gain = way * a0, -way * v
    peak = np.sqrt(max(j * gain + 0.5 * start * start, 0.0))
    flat = 0.0
    if peak > a:
        peak = a
        flat = (gain - (2.0 * a * a - start * start) / (2.0 * j)) / a
    return (
        np.array([max(peak - start, 0.0) / j, flat, peak / j]),
        np.array([way * j, 0.0, -way * j]),
    )


def _ending_at(motion: Trajectory, q: JointVector) -> Trajectory:
    """The motion with rounding of its end taken out."""
    motion.q[-1] = q
    motion.qd[-1] = 0.0
    motion.qdd[-1] = 0.0
    return motion


def stopping_at_corners(path: JointPath, limits: JointLimits) -> Trajectory:
    """Along a (k, n) path, resting at every waypoint: exactly on the path, and never far off."""
    path = np.asarray(path, float)
    if len(path) == 1:
        return hold(path[0])
    return join([straight(a, b, limits) for a, b in pairwise(path)])
