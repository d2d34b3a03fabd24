"""Compiled kinematics of a serial chain; plain-numpy twins are in the tests.

All of them take the arrays of a :class:`~armsight.robots.robot.Robot` (``T_link_joint``, ``axis``)
and give poses in ``base``. They hold no lock (``nogil``) and may be called from other compiled
code; the ``*_into`` forms write to an array of the caller and allocate nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointPath, JointVector, Points, Pose, Poses


@njit(cache=True, nogil=True)
def chain_poses_into(q: JointVector, T_link_joint: Poses, axis: Points, out: Poses) -> None:
    """Write ``T_base_link`` of every link to ``out`` (n + 1, 4, 4) at (n,) positions [rad]."""
    n = q.shape[0]
    for r in range(4):
        for c in range(4):
            out[0, r, c] = 1.0 if r == c else 0.0
    for i in range(n):
        T = T_link_joint[i]
        P = out[i]
        N = out[i + 1]
        s = np.sin(q[i])
        c1 = np.cos(q[i])
        v = 1.0 - c1
        x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
        # Rodrigues' rotation about the unit axis.
        r00, r01, r02 = c1 + x * x * v, x * y * v - z * s, x * z * v + y * s
        r10, r11, r12 = y * x * v + z * s, c1 + y * y * v, y * z * v - x * s
        r20, r21, r22 = z * x * v - y * s, z * y * v + x * s, c1 + z * z * v
        for r in range(3):
            # Row r of P @ T, then times the rotation.
            a = P[r, 0] * T[0, 0] + P[r, 1] * T[1, 0] + P[r, 2] * T[2, 0]
            b = P[r, 0] * T[0, 1] + P[r, 1] * T[1, 1] + P[r, 2] * T[2, 1]
            d = P[r, 0] * T[0, 2] + P[r, 1] * T[1, 2] + P[r, 2] * T[2, 2]
            N[r, 0] = a * r00 + b * r10 + d * r20
            N[r, 1] = a * r01 + b * r11 + d * r21
            N[r, 2] = a * r02 + b * r12 + d * r22
            N[r, 3] = P[r, 0] * T[0, 3] + P[r, 1] * T[1, 3] + P[r, 2] * T[2, 3] + P[r, 3]
        N[3, 0] = 0.0
        N[3, 1] = 0.0
        N[3, 2] = 0.0
        N[3, 3] = 1.0


@njit(cache=True, nogil=True)
def chain_poses(q: JointVector, T_link_joint: Poses, axis: Points) -> Poses:
    """(n + 1, 4, 4) ``T_base_link`` of every link at (n,) joint positions [rad]."""
    out = np.empty((q.shape[0] + 1, 4, 4))
    chain_poses_into(q, T_link_joint, axis, out)
    return out


@njit(cache=True, nogil=True)
def carried_points_into(poses: Poses, link: Ints, points: Points, out: Points) -> None:
    """Write (m, 3) points fixed to links, moved to ``base`` by (n + 1, 4, 4) poses, to ``out``."""
    for k in range(link.shape[0]):
        T = poses[link[k]]
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        out[k, 0] = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        out[k, 1] = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        out[k, 2] = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]


@njit(cache=True, nogil=True)
def carried_points(poses: Poses, link: Ints, points: Points) -> Points:
    """(m, 3) points fixed to links, moved to ``base`` by (n + 1, 4, 4) poses."""
    out = np.empty((link.shape[0], 3))
    carried_points_into(poses, link, points, out)
    return out


@njit(cache=True, nogil=True)
def carried_motion_into(
    poses: Poses,
    axis: Points,
    link: Ints,
    points: Points,
    q_dot: JointVector,
    out: Points,
    out_velocity: Points,
) -> None:
    """Write (m, 3) points fixed to links, in ``base`` [m], and their velocities [m/s].

    Of the arguments:
        q_dot: (n,) rates of the joints [rad/s] that ``poses`` (n + 1, 4, 4) came from.
    """
    n = axis.shape[0]
    # Twist of each link about the base's origin: angular w and linear u = velocity of the origin.
    w = np.zeros((n + 1, 3))
    u = np.zeros((n + 1, 3))
    for j in range(n):
        T = poses[j + 1]
        ax = T[0, 0] * axis[j, 0] + T[0, 1] * axis[j, 1] + T[0, 2] * axis[j, 2]
        ay = T[1, 0] * axis[j, 0] + T[1, 1] * axis[j, 1] + T[1, 2] * axis[j, 2]
        az = T[2, 0] * axis[j, 0] + T[2, 1] * axis[j, 1] + T[2, 2] * axis[j, 2]
        s = q_dot[j]
        px, py, pz = T[0, 3], T[1, 3], T[2, 3]
        w[j + 1, 0] = w[j, 0] + s * ax
        w[j + 1, 1] = w[j, 1] + s * ay
        w[j + 1, 2] = w[j, 2] + s * az
        u[j + 1, 0] = u[j, 0] + s * (py * az - pz * ay)
        u[j + 1, 1] = u[j, 1] + s * (pz * ax - px * az)
        u[j + 1, 2] = u[j, 2] + s * (px * ay - py * ax)
    for k in range(link.shape[0]):
        i = link[k]
        T = poses[i]
        x = T[0, 0] * points[k, 0] + T[0, 1] * points[k, 1] + T[0, 2] * points[k, 2] + T[0, 3]
        y = T[1, 0] * points[k, 0] + T[1, 1] * points[k, 1] + T[1, 2] * points[k, 2] + T[1, 3]
        z = T[2, 0] * points[k, 0] + T[2, 1] * points[k, 1] + T[2, 2] * points[k, 2] + T[2, 3]
        out[k, 0], out[k, 1], out[k, 2] = x, y, z
        out_velocity[k, 0] = u[i, 0] + w[i, 1] * z - w[i, 2] * y
        out_velocity[k, 1] = u[i, 1] + w[i, 2] * x - w[i, 0] * z
        out_velocity[k, 2] = u[i, 2] + w[i, 0] * y - w[i, 1] * x


@njit(cache=True, nogil=True)
def path_points(
    path: JointPath, T_link_joint: Poses, axis: Points, link: Ints, points: Points
) -> Floats:
    """(k, m, 3) points fixed to links, in ``base``, at each of (k, n) configurations."""
    k = path.shape[0]
    poses = np.empty((path.shape[1] + 1, 4, 4))
    out = np.empty((k, link.shape[0], 3))
    for i in range(k):
        chain_poses_into(path[i], T_link_joint, axis, poses)
        carried_points_into(poses, link, points, out[i])
    return out


@njit(cache=True, nogil=True)
def joint_screws(poses: Poses, axis: Points) -> Floats:
    """(n, 6) axis direction and a point on it, in ``base``, of every joint.

    A joint's frame differs from its link's only by the turn about the axis itself, so the link's
    pose gives both.
    """
    n = axis.shape[0]
    out = np.empty((n, 6))
    for i in range(n):
        T = poses[i + 1]
        for r in range(3):
            out[i, r] = T[r, 0] * axis[i, 0] + T[r, 1] * axis[i, 1] + T[r, 2] * axis[i, 2]
            out[i, 3 + r] = T[r, 3]
    return out


@njit(cache=True, nogil=True)
def jacobian(poses: Poses, axis: Points, link: int, point_base: Points) -> Floats:
    """(6, n) geometric Jacobian of a point that moves with a link: linear [m/rad], angular.

    Columns of joints beyond the link are zero.
    """
    n = axis.shape[0]
    out = np.zeros((6, n))
    for i in range(min(link, n)):
        T = poses[i + 1]
        x = T[0, 0] * axis[i, 0] + T[0, 1] * axis[i, 1] + T[0, 2] * axis[i, 2]
        y = T[1, 0] * axis[i, 0] + T[1, 1] * axis[i, 1] + T[1, 2] * axis[i, 2]
        z = T[2, 0] * axis[i, 0] + T[2, 1] * axis[i, 1] + T[2, 2] * axis[i, 2]
        dx = point_base[0] - T[0, 3]
        dy = point_base[1] - T[1, 3]
        dz = point_base[2] - T[2, 3]
        out[0, i] = y * dz - z * dy
        out[1, i] = z * dx - x * dz
        out[2, i] = x * dy - y * dx
        out[3, i] = x
        out[4, i] = y
        out[5, i] = z
    return out


@njit(cache=True, nogil=True)
def compose(T_a_b: Pose, T_b_c: Pose) -> Pose:
    """``T_a_c`` of two rigid transforms (cheaper than a general product)."""
    out = np.empty((4, 4))
    for r in range(3):
        for c in range(3):
            out[r, c] = (
                T_a_b[r, 0] * T_b_c[0, c] + T_a_b[r, 1] * T_b_c[1, c] + T_a_b[r, 2] * T_b_c[2, c]
            )
        out[r, 3] = (
            T_a_b[r, 0] * T_b_c[0, 3]
            + T_a_b[r, 1] * T_b_c[1, 3]
            + T_a_b[r, 2] * T_b_c[2, 3]
            + T_a_b[r, 3]
        )
    out[3, 0] = 0.0
    out[3, 1] = 0.0
    out[3, 2] = 0.0
    out[3, 3] = 1.0
    return out
