"""The arm's motion ahead, compiled: what its drives make of commands, and how it stops."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointVector, Points, Poses


@njit(cache=True, nogil=True)
def drive_ahead(
    q: JointVector,
    q_dot: JointVector,
    until: Floats,
    target: Points,
    braking: np.ndarray,
    acceleration: JointVector,
    brake: JointVector,
    start: float,
) -> None:
    """Move (n,) joints in place through commands that are on their way.

    Each joint ramps towards the command in force; the last command holds until its time.

    Args:
        q: (n,) positions at ``start`` [rad], overwritten by those at ``until[-1]``.
        q_dot: (n,) velocities [rad/s], likewise.
        until: (k,) end of each command's time [s].
        target: (k, n) commanded velocities [rad/s].
        braking: (k,) bool, a stop instead of a command.
        acceleration: (n,) ramp of commands [rad/s^2].
        brake: (n,) ramp of stops [rad/s^2].
        start: time of the state [s].
    """
    t = start
    for k in range(until.shape[0]):
        dt = until[k] - t
        if dt <= 0.0:
            continue
        for j in range(q.shape[0]):
            a = brake[j] if braking[k] else acceleration[j]
            wanted = 0.0 if braking[k] else target[k, j]
            change = wanted - q_dot[j]
            ramp = min(abs(change) / a, dt) if a > 0.0 else 0.0
            signed = a if change > 0.0 else -a
            q[j] += q_dot[j] * ramp + 0.5 * signed * ramp * ramp
            q_dot[j] += signed * ramp
            if ramp < dt:
                q_dot[j] = wanted
                q[j] += wanted * (dt - ramp)
        t = until[k]


@njit(cache=True, nogil=True)
def braked(
    q: JointVector, q_dot: JointVector, brake: JointVector, times: Floats
) -> tuple[Points, Points]:
    """(k, n) positions and velocities while every joint brakes as hard as it can.

    Args:
        q: (n,) positions where it begins [rad].
        q_dot: (n,) velocities there [rad/s].
        brake: (n,) ramp of the stop [rad/s^2].
        times: (k,) from its beginning [s].
    """
    n = q.shape[0]
    at, speed = np.empty((times.shape[0], n)), np.empty((times.shape[0], n))
    for k in range(times.shape[0]):
        for j in range(n):
            own = min(times[k], abs(q_dot[j]) / brake[j])
            slow = brake[j] if q_dot[j] > 0.0 else -brake[j]
            at[k, j] = q[j] + q_dot[j] * own - 0.5 * slow * own * own
            left = max(abs(q_dot[j]) - brake[j] * own, 0.0)
            speed[k, j] = left if q_dot[j] > 0.0 else -left
    return at, speed


@njit(cache=True, nogil=True)
def stop_path(q: JointVector, q_dot: JointVector, brake: JointVector, pieces: int) -> Points:
    """(pieces + 1, n) positions while every joint brakes as hard as it can, ends included."""
    longest = 0.0
    for j in range(q.shape[0]):
        longest = max(longest, abs(q_dot[j]) / brake[j])
    times = np.empty(pieces + 1)
    for k in range(pieces + 1):
        times[k] = longest * k / pieces
    return braked(q, q_dot, brake, times)[0]


@njit(cache=True, nogil=True)
def stopping_times(q_dot: JointVector, brake: JointVector, link: Ints, out: Floats) -> None:
    """Write (m,) seconds until everything that moves each sphere's link has stopped."""
    n = q_dot.shape[0]
    until = np.zeros(n + 1)
    for j in range(n):
        until[j + 1] = max(until[j], abs(q_dot[j]) / brake[j])
    for k in range(link.shape[0]):
        out[k] = until[link[k]]


@njit(cache=True, nogil=True)
def fastest_point(
    poses: Poses, axis: Points, link: Ints, radius: Floats, q_dot: JointVector, velocity: Points
) -> float:
    """No point of (m,) spheres fixed to links is faster than this [m/s].

    A sphere's surface turns about its centre with the link.

    Args:
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        link: (m,) that carries each sphere.
        radius: (m,) [m].
        q_dot: (n,) [rad/s].
        velocity: (m, 3) of the centres [m/s].
    """
    n = axis.shape[0]
    spin = np.zeros(n + 1)
    wx, wy, wz = 0.0, 0.0, 0.0
    for j in range(n):
        T = poses[j + 1]
        x, y, z = q_dot[j] * axis[j, 0], q_dot[j] * axis[j, 1], q_dot[j] * axis[j, 2]
        wx += T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        wy += T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        wz += T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        spin[j + 1] = np.sqrt(wx * wx + wy * wy + wz * wz)
    fastest = 0.0
    for k in range(link.shape[0]):
        vx, vy, vz = velocity[k, 0], velocity[k, 1], velocity[k, 2]
        speed = np.sqrt(vx * vx + vy * vy + vz * vz) + radius[k] * spin[link[k]]
        fastest = max(fastest, speed)
    return fastest
