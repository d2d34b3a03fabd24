"""A path in time: as fast as joint speed, acceleration and jerk limits allow, rounded where proven.

Corners become parabolas, timed optimally for speed and acceleration. A moving average over time
then bounds the jerk: averages of speeds and accelerations within their limits are within them, and
a window T turns the greatest jump of acceleration, 2a, into a jerk of 2a / T. The result is a
uniform cubic B-spline, whose limits can be read off its control points.

Rounding and averaging leave the path a little, so a motion counts only once it is proven itself;
where a proof fails the corner nearest to the failure is made tighter, and in the end the arm rests
at it, on a path that was proven before.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from armsight.arrays import Floats, JointPath
from armsight.motion.blending import RoundedPath, round_corners, widest_reach
from armsight.motion.timing_kernels import fastest_profile, sample_profile
from armsight.motion.trajectory import Trajectory, hold, join, stopping_at_corners, straight
from armsight.robots.robot import JointLimits

WINDOW = 8
"""Samples in the moving average: the averaged motion's jerk is constant between samples."""
WINDOWS = (1.0, 1.25, 1.6, 2.0)
"""Window lengths that are tried, in units of acceleration limit over jerk limit."""
ROUNDS = 6
"""How often corners are made tighter before the arm rests at those that still fail."""

Blocked = Callable[[Trajectory], float | None]
"""Says at which time [s] a motion is not proven free, or None."""


def time_parameterise(
    path: JointPath, limits: JointLimits, blocked: Blocked | None = None
) -> Trajectory:
    """The motion along a (k, n) path from rest to rest.

    Args:
        path: waypoints [rad]; equal neighbours count once.
        limits: velocity, acceleration and jerk are kept at every instant.
        blocked: proves motions; without it the motion may pass corners on the inside by as much
            as their lines allow, so give it whenever anything is near.
    """
    path = distinct(path)
    if len(path) == 1:
        return hold(path[0])
    if len(path) == 2:
        return straight(path[0], path[1], limits)
    reach = widest_reach(path)
    motion = rounded(path, reach, limits)
    if blocked is None:
        return motion
    stops = np.zeros(len(path), bool)
    for round_ in range(ROUNDS + len(path)):
        when = blocked(motion)
        if when is None:
            return motion
        corner = _corner_at(motion.position(when), path, stops)
        if corner is None:
            break
        reach[corner] *= 0.4
        if reach[corner] < 0.01 or round_ >= ROUNDS:
            reach[corner] = 0.0
            stops[corner] = True
        motion = rounded(path, reach, limits)
    return stopping_at_corners(path, limits)


def rounded(path: JointPath, reach: Floats, limits: JointLimits) -> Trajectory:
    """The motion with given reaches of the corners; it rests at those of none."""
    inner = np.flatnonzero(np.asarray(reach)[1:-1] <= 0.0) + 1
    marks = [0, *inner.tolist(), len(path) - 1]
    return join(
        [_without_rest(path[a : b + 1], reach[a : b + 1], limits) for a, b in pairwise(marks)]
    )


def distinct(path: JointPath) -> JointPath:
    """A path without waypoints that repeat the one before them."""
    path = np.asarray(path, float)
    keep = np.ones(len(path), bool)
    keep[1:] = np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-9
    if not keep[-1] and len(path) > 1:
        # The goal itself is kept, its double goes.
        last = np.flatnonzero(keep)[-1]
        path = path.copy()
        if last > 0:
            path[last] = path[-1]
    return np.asarray(path[keep])


def _corner_at(q: Floats, path: JointPath, stops: np.ndarray) -> int | None:
    """The inner waypoint nearest to a configuration among those not rested at."""
    distance = np.linalg.norm(path - q, axis=1)
    distance[0] = distance[-1] = np.inf
    distance[stops] = np.inf
    best = int(np.argmin(distance))
    return best if np.isfinite(distance[best]) else None


def _without_rest(path: JointPath, reach: Floats, limits: JointLimits) -> Trajectory:
    if len(path) == 2:
        return straight(path[0], path[1], limits)
    shape = round_corners(path, reach)
    x = fastest_profile(
        shape.tangent,
        shape.tangent_end,
        shape.curve,
        shape.length,
        limits.velocity,
        limits.acceleration,
    )
    unit = float((limits.acceleration / limits.jerk).max())
    tries = [_averaged(shape, x, path[-1], unit * w, limits) for w in WINDOWS]
    return min(tries, key=lambda t: t.duration)


def _averaged(
    shape: RoundedPath, x: Floats, goal: Floats, window: float, limits: JointLimits
) -> Trajectory:
    """The timed path under a moving average of a length [s], slowed if a limit asks for it."""
    dt = window / WINDOW
    where, place = sample_profile(x, shape.length, dt)
    samples = shape.position(where, place)
    samples[-1] = goal
    n = samples.shape[1]
    padded = np.concatenate(
        [np.repeat(samples[:1], WINDOW + 1, axis=0), samples, np.repeat(goal[None], WINDOW + 1, 0)]
    )
    total = np.concatenate([np.zeros((1, n)), np.cumsum(padded, axis=0)])
    control = (total[WINDOW:] - total[:-WINDOW]) / WINDOW
    motion = _spline(control, dt)
    speed, acceleration, jerk = motion.peak()
    factor = max(
        float((speed / limits.velocity).max()),
        float(np.sqrt((acceleration / limits.acceleration).max())),
        float(np.cbrt((jerk / limits.jerk).max())),
    )
    return motion.slowed(factor * (1.0 + 1e-9)) if factor > 1.0 else motion


def _spline(control: JointPath, dt: float) -> Trajectory:
    """The uniform cubic B-spline of (m, n) control points, ends repeated, as a trajectory."""
    p = np.concatenate([control[:1], control[:1], control, control[-1:], control[-1:]])
    first = np.diff(p, axis=0) / dt
    second = np.diff(first, axis=0) / dt
    third = np.diff(second, axis=0) / dt
    knots = len(p) - 2
    q = (p[:-2] + 4.0 * p[1:-1] + p[2:]) / 6.0
    qd = 0.5 * (first[:-1] + first[1:])
    return Trajectory(dt * np.arange(knots, dtype=float), q, qd, second, third)
