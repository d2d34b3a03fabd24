"""Compiled time-optimal timing of a path of straight lines and parabolas, by reachability.

In the phase plane x = (ds/dt)^2, u = d2s/dt2 the limits of a joint are linear; with u constant on
an interval of the path, x is linear there, and so is the acceleration q' u + q'' x on a line or a
parabola: limits kept at both ends of an interval are kept all along it (Pham, Pham, TOPP-RA, 2018).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointPath, JointVector


@njit(cache=True, nogil=True)
def _lines(
    tangent0: JointVector,
    tangent1: JointVector,
    curve: JointVector,
    length: float,
    acceleration: JointVector,
    upper: Floats,
    lower: Floats,
) -> float:
    """Write limits u <= a - b x (``upper``) and u >= a - b x (``lower``); returns a limit of x."""
    n = tangent0.shape[0]
    most = np.inf
    for j in range(n):
        for end in range(2):
            alpha = tangent0[j] if end == 0 else tangent1[j] + 2.0 * length * curve[j]
            beta = curve[j]
            k = 2 * j + end
            if abs(alpha) < 1e-12:
                upper[k, 0], upper[k, 1] = np.inf, 0.0
                lower[k, 0], lower[k, 1] = -np.inf, 0.0
                if abs(beta) > 1e-12:
                    most = min(most, acceleration[j] / abs(beta))
                continue
            a = acceleration[j] / abs(alpha)
            b = beta / alpha
            upper[k, 0], upper[k, 1] = a, b
            lower[k, 0], lower[k, 1] = -a, b
    # What remains must be at least rest: x + 2 length u >= 0.
    lower[2 * n, 0], lower[2 * n, 1] = 0.0, 1.0 / (2.0 * length)
    return most


@njit(cache=True, nogil=True)
def fastest_profile(
    tangent0: JointPath,
    tangent1: JointPath,
    curve: JointPath,
    length: Floats,
    velocity: JointVector,
    acceleration: JointVector,
) -> Floats:
    """(k + 1,) greatest x = (ds/dt)^2 at the ends of k intervals, from rest to rest.

    Args:
        tangent0: (k, n) dq/ds where each interval begins; tangent1 where it ends.
        tangent1: see above.
        curve: (k, n) d2q/ds2, constant on each interval.
        length: (k,) of the intervals.
        velocity: (n,) limits [rad/s].
        acceleration: (n,) limits [rad/s^2].
    """
    k, n = curve.shape
    most = np.full(k + 1, np.inf)
    for i in range(k):
        for j in range(n):
            t0, t1 = abs(tangent0[i, j]), abs(tangent1[i, j])
            if t0 > 0.0:
                most[i] = min(most[i], (velocity[j] / t0) ** 2)
            if t1 > 0.0:
                most[i + 1] = min(most[i + 1], (velocity[j] / t1) ** 2)
    upper, lower = np.empty((2 * n + 1, 2)), np.empty((2 * n + 1, 2))
    x = np.zeros(k + 1)
    # Backwards: the greatest x from which rest at the end can still be reached.
    for i in range(k - 1, -1, -1):
        best = min(
            most[i],
            _lines(tangent0[i], tangent1[i], curve[i], length[i], acceleration, upper, lower),
        )
        upper[2 * n, 0] = x[i + 1] / (2.0 * length[i])
        upper[2 * n, 1] = 1.0 / (2.0 * length[i])
        for a in range(2 * n + 1):
            for b in range(2 * n + 1):
                slope = upper[a, 1] - lower[b, 1]
                if slope > 0.0:
                    best = min(best, (upper[a, 0] - lower[b, 0]) / slope)
        x[i] = max(best, 0.0)
    # Forwards: the greatest u each time.
    x[0] = 0.0
    for i in range(k):
        _lines(tangent0[i], tangent1[i], curve[i], length[i], acceleration, upper, lower)
        u = (x[i + 1] - x[i]) / (2.0 * length[i])
        for a in range(2 * n):
            u = min(u, upper[a, 0] - upper[a, 1] * x[i])
        x[i + 1] = min(max(x[i] + 2.0 * length[i] * u, 0.0), x[i + 1])
    return x


@njit(cache=True, nogil=True)
def sample_profile(x: Floats, length: Floats, dt: float) -> tuple[Ints, Floats]:
    """Interval number and place in it, every dt [s] from the start to (just after) the end."""
    k = length.shape[0]
    total = 0.0
    for i in range(k):
        total += 2.0 * length[i] / (np.sqrt(x[i]) + np.sqrt(x[i + 1]))
    count = int(np.ceil(total / dt)) + 1
    where, place = np.empty(count, np.int64), np.empty(count)
    i, begin = 0, 0.0
    span = 2.0 * length[0] / (np.sqrt(x[0]) + np.sqrt(x[1]))
    for c in range(count):
        t = c * dt
        while i < k - 1 and t > begin + span:
            begin += span
            i += 1
            span = 2.0 * length[i] / (np.sqrt(x[i]) + np.sqrt(x[i + 1]))
        u = (x[i + 1] - x[i]) / (2.0 * length[i])
        s = t - begin
        place[c] = min(max(np.sqrt(x[i]) * s + 0.5 * u * s * s, 0.0), length[i])
        if s >= span:
            place[c] = length[i]
        where[c] = i
    return where, place
