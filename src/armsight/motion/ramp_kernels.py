"""Compiled ramps: how a joint's commanded velocity may change from one tick to the next.

A command is a velocity that holds until the next one; its acceleration is the change of velocity
over the time between two commands, its jerk the change of that. The laws below keep both within
bounds in *this* discrete sense, exactly, and look at the stop that would follow by playing it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import JointVector

LONGEST = 4000
"""Ticks of a stop that is played; every stop is shorter by far."""
HALVINGS = 24
"""Steps of the search for the greatest acceleration that still stops before a limit."""


@njit(cache=True, nogil=True)
def acceleration_towards(
    v: float,
    a: float,
    target: float,
    most: float,
    jerk: float,
    seconds: float,
    period: float,
) -> float:
    """The acceleration of this tick that brings a velocity to a target soonest, without overshoot.

    It is the greatest from which the acceleration can be let go by ``jerk``, tick by tick, before
    the velocity passes the target. With this tick of dt and n more of a period p, that adds up to
    ``a dt + p (n a - j p n (n + 1) / 2)``, where n is how often j p goes into a.

    Args:
        v: velocity of the tick before [rad/s].
        a: acceleration of the tick before [rad/s^2].
        target: wanted velocity [rad/s].
        most: greatest acceleration [rad/s^2].
        jerk: greatest change of it [rad/s^3].
        seconds: length of the tick [s].
        period: of those to come [s].
    """
    left = target - v
    way = 1.0 if left >= 0.0 else -1.0
    step = jerk * period
    best, n = abs(left) / seconds, 0.0
    while best >= (n + 1.0) * step and n * step < most:
        n += 1.0
        best = (abs(left) + 0.5 * step * period * n * (n + 1.0)) / (seconds + n * period)
    best = way * min(best, most)
    change = jerk * seconds
    return min(max(best, a - change), a + change)


@njit(cache=True, nogil=True)
def stop_extent(
    v: float, a: float, most: float, jerk: float, seconds: float
) -> tuple[float, float]:
    """How far (up, down) a joint still goes when it comes to rest tick by tick [rad], both >= 0."""
    x, high, low = 0.0, 0.0, 0.0
    for _ in range(LONGEST):
        if abs(v) < 1e-9 and abs(a) < 1e-9:
            break
        a = acceleration_towards(v, a, 0.0, most, jerk, seconds, seconds)
        before = v
        v += a * seconds
        # The drives take some of the tick to get there: count the greater of both velocities.
        high = max(high, x + max(before, v, 0.0) * seconds)
        low = min(low, x + min(before, v, 0.0) * seconds)
        x += v * seconds
    return high, -low


@njit(cache=True, nogil=True)
def ramp(
    target: JointVector,
    q: JointVector,
    v: JointVector,
    a: JointVector,
    lower: JointVector,
    upper: JointVector,
    speed: JointVector,
    acceleration: JointVector,
    jerk: JointVector,
    seconds: float,
    period: float,
) -> JointVector:
    """(n,) velocities to command now, on the way to a target, within every limit of every joint.

    Joints that have less to change go slower, so that all arrive together and the motion keeps its
    direction; none goes where it could not stop, within its limits, before its end of travel.

    Args:
        target: (n,) wanted [rad/s].
        q: (n,) where the joints are when the command acts [rad].
        v: (n,) commanded a tick ago [rad/s].
        a: (n,) acceleration of that command [rad/s^2].
        lower: (n,) ends of travel below [rad].
        upper: (n,) ends of travel above [rad].
        speed: (n,) greatest velocity [rad/s].
        acceleration: (n,) greatest acceleration [rad/s^2].
        jerk: (n,) greatest jerk [rad/s^3].
        seconds: since the last command [s].
        period: until the next, and from then on [s].
    """
    n = target.shape[0]
    wanted = np.empty(n)
    fastest = 1.0
    for j in range(n):
        fastest = max(fastest, abs(target[j]) / speed[j])
    longest = 0.0
    for j in range(n):
        wanted[j] = target[j] / fastest
        longest = max(longest, abs(wanted[j] - v[j]) / acceleration[j])
    out = np.empty(n)
    for j in range(n):
        A, J, dt = acceleration[j], jerk[j], seconds
        share = 1.0
        if longest > 1e-12:
            share = min(max(abs(wanted[j] - v[j]) / (A * longest), 0.02), 1.0)
        quick = acceleration_towards(v[j], a[j], wanted[j], A, J, dt, period)
        best = acceleration_towards(v[j], a[j], wanted[j], share * A, share * J, dt, period)
        # A gentler law may not be able to take back what a joint does already; the full one can.
        change = J * dt
        best = min(max(best, a[j] - change), a[j] + change)
        if (wanted[j] - v[j]) * a[j] < 0.0 or abs(a[j]) > 1.05 * share * A + change:
            best = quick
        # Nor may it be let go so gently that the target is passed.
        best = min(best, quick) if wanted[j] >= v[j] else max(best, quick)
        best = min(best, max(_greatest(v[j], speed[j], J, dt), a[j] - change))
        best = max(best, min(-_greatest(-v[j], speed[j], J, dt), a[j] + change))
        rest = acceleration_towards(v[j], a[j], 0.0, A, J, dt, period)
        out[j] = v[j] + dt * _stopping_in(
            q[j], v[j], best, rest, lower[j], upper[j], A, J, dt, period
        )
    return out


@njit(cache=True, nogil=True)
def _greatest(v: float, speed: float, jerk: float, seconds: float) -> float:
    """The greatest acceleration that can be let go before the speed limit, however ticks fall.

    Ticks are not all as long as they should be, and let go in shorter ones an acceleration a adds
    more to the velocity: in the limit a^2 / (2 j). Where v + a dt + a^2 / (2 j) is within the limit
    now, it is after any further tick in which the acceleration is let go by the jerk.
    """
    room = max(speed - v, 0.0)
    step = jerk * seconds
    return float(np.sqrt(step * step + 2.0 * jerk * room) - step)


@njit(cache=True, nogil=True)
def _fits(
    q: float,
    v: float,
    a: float,
    lower: float,
    upper: float,
    most: float,
    jerk: float,
    seconds: float,
    period: float,
) -> tuple[bool, bool]:
    """Whether a joint that accelerates with ``a`` for a tick still stops below and above."""
    after = v + a * seconds
    up, down = stop_extent(after, a, most, jerk, period)
    top = q + max(v, after, 0.0) * period + up
    bottom = q + min(v, after, 0.0) * period - down
    return bottom >= lower, top <= upper


@njit(cache=True, nogil=True)
def _stopping_in(
    q: float,
    v: float,
    best: float,
    rest: float,
    lower: float,
    upper: float,
    most: float,
    jerk: float,
    seconds: float,
    period: float,
) -> float:
    """The acceleration nearest to the best one from which the joint stops within its travel."""
    above, below = _fits(q, v, best, lower, upper, most, jerk, seconds, period)
    if best > rest and below:
        return best
    if best < rest and above:
        return best
    if best == rest:
        return best
    good, bad = rest, best
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        above, below = _fits(q, v, middle, lower, upper, most, jerk, seconds, period)
        if below if best > rest else above:
            good = middle
        else:
            bad = middle
    return good
