"""Compiled inner loops of contact permits: what of a map is near a region, and how fast parts come.

Their plain-numpy twins are in the tests.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, JointVector, Mask, Points, Poses, Vector3
from armsight.motion.drive_kernels import stopping_times
from armsight.robots.kernels import carried_motion_into

BISECTIONS = 24
"""Halvings of the share of a motion: to less than a millionth."""


class Touch(NamedTuple):
    """The k parts that may touch at one place of an arm of n joints, and what they may touch.

    Attributes:
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        brake: (n,) deceleration of each joint [rad/s^2].
        link: (k,) that carries each part.
        local: (k, 3) its centre there [m].
        radius: (k,) [m].
        gap: (k,) to the region's border [m].
        towards: (k, 3) unit, to the region's nearest point.
        outward: (k, 3) unit, by which they leave it; zero where leaving is no better than rubbing.
        region: (3,) its velocity [m/s].
        speed: v_c [m/s].
        lag: T_a: for this long the arm goes on as commanded [s].
        unsure: the region may come faster than it is known to by this [m/s].
    """

    poses: Poses
    axis: Points
    brake: JointVector
    link: Ints
    local: Points
    radius: Floats
    gap: Floats
    towards: Points
    outward: Points
    region: Vector3
    speed: float
    lag: float
    unsure: float


@njit(cache=True, nogil=True)
def in_box(points: Floats32, center: Vector3, reach: float, out: Ints) -> int:
    """Write the indices of the (n, 3) points in a cube of half edge ``reach`` [m]; how many."""
    count = 0
    for i in range(points.shape[0]):
        if (
            abs(points[i, 0] - center[0]) <= reach
            and abs(points[i, 1] - center[1]) <= reach
            and abs(points[i, 2] - center[2]) <= reach
        ):
            out[count] = i
            count += 1
    return count


@njit(cache=True, nogil=True)
def leave_out(points: Floats32, marks: Mask, taken: Ints, out: Floats32, out_marks: Mask) -> None:
    """Copy (n, 3) points and their (n,) marks but those whose ascending indices are ``taken``."""
    row, k = 0, 0
    for i in range(points.shape[0]):
        if k < taken.shape[0] and taken[k] == i:
            k += 1
            continue
        out[row, 0], out[row, 1], out[row, 2] = points[i, 0], points[i, 1], points[i, 2]
        out_marks[row] = marks[i]
        row += 1


@njit(cache=True, nogil=True)
def turning_speeds(poses: Poses, axis: Points, q_dot: JointVector, out: Floats) -> None:
    """Write how fast each of (n + 1) links turns [rad/s]."""
    wx = wy = wz = 0.0
    out[0] = 0.0
    for j in range(axis.shape[0]):
        T, s = poses[j + 1], q_dot[j]
        wx += s * (T[0, 0] * axis[j, 0] + T[0, 1] * axis[j, 1] + T[0, 2] * axis[j, 2])
        wy += s * (T[1, 0] * axis[j, 0] + T[1, 1] * axis[j, 1] + T[1, 2] * axis[j, 2])
        wz += s * (T[2, 0] * axis[j, 0] + T[2, 1] * axis[j, 1] + T[2, 2] * axis[j, 2])
        out[j + 1] = np.sqrt(wx * wx + wy * wy + wz * wz)


@njit(cache=True, nogil=True)
def motion_shares(motion: JointVector, touch: Touch) -> Floats:
    """(k,) share of a motion (n,) [rad/s] that the law of contact allows to each part.

    inf where it allows all of it.
    """
    center, velocity = np.empty((touch.link.shape[0], 3)), np.empty((touch.link.shape[0], 3))
    carried_motion_into(touch.poses, touch.axis, touch.link, touch.local, motion, center, velocity)
    turning = np.empty(touch.axis.shape[0] + 1)
    turning_speeds(touch.poses, touch.axis, motion, turning)
    stopping, out = np.empty(touch.link.shape[0]), np.empty(touch.link.shape[0])
    stopping_times(motion, touch.brake, touch.link, stopping)
    speed, lag, region = touch.speed, touch.lag, touch.region
    for i in range(velocity.shape[0]):
        v, gap = velocity[i], touch.gap[i]
        spin = turning[touch.link[i]] * touch.radius[i]  # what turning adds at most [m/s]
        if gap > 0.0:
            length = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            a = max((length + spin) / max(stopping[i], 1e-6), 1e-3)
            root = np.sqrt((a * lag) ** 2 + 2.0 * a * gap + speed * speed)
            most = max(speed, root - a * lag - touch.unsure)
            n = touch.towards[i]
            closing = v[0] * n[0] + v[1] * n[1] + v[2] * n[2] + spin
            meets = most + region[0] * n[0] + region[1] * n[1] + region[2] * n[2]
            out[i] = max(meets / closing, 0.0) if closing > 0.0 else np.inf
        else:
            out[i] = share_within(v, region, touch.outward[i], spin, speed)
    return out


@njit(cache=True, nogil=True)
def eased_share(along: JointVector, rest: JointVector, halvings: int, touch: Touch) -> float:
    """Greatest s in 0..1 at which ``along + s rest`` is allowed to all parts, bisected.

    -1 where even ``along`` is not.
    """
    good, bad, share = -1.0, 1.0, 1.0
    for k in range(halvings + 2):  # all of it, none, and then between
        allowed = motion_shares(along + share * rest, touch)
        if allowed.min() >= 1.0:
            if k == 0:
                return 1.0
            good = share
        elif k == 1:
            return -1.0
        else:
            bad = share
        share = 0.0 if k == 0 else 0.5 * (good + bad)
    return good


@njit(cache=True, nogil=True)
def share_within(
    velocity: Vector3, region: Vector3, outward: Vector3, spin: float, most: float
) -> float:
    """Greatest share s of a motion at which ``|s v - v_region| + s spin <= most``; 0 where none is.

    What of ``s v - v_region`` leads outward, which is a unit vector or zero, does not count. The
    left side is convex in s, so what is allowed is an interval: its upper end is bisected.
    """
    if _excess(1.0, velocity, region, outward, spin, most) <= 0.0:
        return np.inf
    square = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    along = velocity[0] * region[0] + velocity[1] * region[1] + velocity[2] * region[2]
    allowed = min(max(along / max(square, 1e-12), 0.0), 1.0)
    if _excess(allowed, velocity, region, outward, spin, most) > 0.0:
        allowed = 0.0
        if _excess(allowed, velocity, region, outward, spin, most) > 0.0:
            return 0.0
    refused = 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (allowed + refused)
        if _excess(middle, velocity, region, outward, spin, most) <= 0.0:
            allowed = middle
        else:
            refused = middle
    return allowed


@njit(cache=True, nogil=True)
def _excess(
    share: float, velocity: Vector3, region: Vector3, outward: Vector3, spin: float, most: float
) -> float:
    x = share * velocity[0] - region[0]
    y = share * velocity[1] - region[1]
    z = share * velocity[2] - region[2]
    leaves = max(x * outward[0] + y * outward[1] + z * outward[2], 0.0)
    x, y, z = x - leaves * outward[0], y - leaves * outward[1], z - leaves * outward[2]
    return np.sqrt(x * x + y * y + z * z) + share * spin - most


@njit(cache=True, nogil=True)
def closing_shares(
    center: Points,
    velocity: Points,
    radius: Floats,
    firm: Floats32,
    somebody: Floats32,
    speed: float,
    gap: tuple[float, float, float],
    out: Floats,
) -> None:
    """The share of a motion at which no sphere closes in on a firm point faster than it may.

    It may the faster the farther it is from that, and from whom it could press against it.

    Args:
        center: (m, 3) of the spheres [m].
        velocity: (m, 3) of these [m/s].
        radius: (m,) of the spheres, with the points' own [m].
        firm: (f, 3) [m].
        somebody: (s, 3) where what is touched may be [m].
        speed: allowed within the gap [m/s].
        gap: how wide that is [m], by how much the speed rises beyond [1/s], where it ends [m].
        out: (m,) the shares; left alone where nothing firm is approached.
    """
    narrow, rise, end = gap
    for i in range(center.shape[0]):
        reach, free = radius[i] + end, -1.0
        for j in range(firm.shape[0]):
            x, y, z = (
                firm[j, 0] - center[i, 0],
                firm[j, 1] - center[i, 1],
                firm[j, 2] - center[i, 2],
            )
            square = x * x + y * y + z * z
            if square > reach * reach:
                continue
            closing = x * velocity[i, 0] + y * velocity[i, 1] + z * velocity[i, 2]
            if closing <= 0.0:
                continue
            if free < 0.0:
                free = max(_least_distance(center[i], somebody) - radius[i], 0.0)
            away = max(math.sqrt(square), 1e-9)
            allowed = speed + rise * max(away - radius[i] - narrow, free)
            out[i] = min(out[i], allowed * away / closing)


@njit(cache=True, nogil=True)
def _least_distance(point: Vector3, others: Floats32) -> float:
    """From (3,) a point to the nearest of (k, 3) others [m]; without any, farther than anything."""
    least = 1e12
    for j in range(others.shape[0]):
        x, y, z = others[j, 0] - point[0], others[j, 1] - point[1], others[j, 2] - point[2]
        least = min(least, x * x + y * y + z * z)
    return math.sqrt(least)
