"""Compiled loops of the fit of an arm to its landmarks; numpy twins are in the tests.

Places in the picture are normalised: x / z and y / z. A pose is ``T_camera_base``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, Points, Poses
from armsight.robots.kernels import carried_points, chain_poses, compose, joint_screws

CORE = 2.0
"""Whitened distance at which a landmark counts half (Cauchy)."""
SLACK = 0.03
"""Standard deviation of a joint beyond its limit [rad]."""


@njit(cache=True, nogil=True, fastmath=True)
def weak_perspective(
    shapes: Floats32,
    frames: Floats32,
    at: Floats32,
    weight: Floats32,
    cost: Floats32,
    found: Floats32,
) -> None:
    """For each shape the view from far that explains the picture best, by a turn, scale and shift.

    With a and b the centred places as complex numbers, the best factor is sum(w conj(a) b) /
    sum(w |a|^2), and what is left sum(w |b|^2) less |sum(w conj(a) b)|^2 / sum(w |a|^2).

    Args:
        shapes: (n, p, 3) landmarks in base [m].
        frames: (d, 3, 3) views: rows are the camera's axes in base.
        at: (p, 2) where they are seen.
        weight: (p,) inverse variances, 0 where not.
        cost: (n,) what is left, written.
        found: (n, 5) view, real and imaginary part of the factor, shift in x and y, written.
    """
    n, p = shapes.shape[0], shapes.shape[1]
    total = weight.sum()
    bx, by, power = 0.0, 0.0, 0.0
    for k in range(p):
        bx += weight[k] * at[k, 0]
        by += weight[k] * at[k, 1]
    bx, by = bx / total, by / total
    for k in range(p):
        power += weight[k] * ((at[k, 0] - bx) ** 2 + (at[k, 1] - by) ** 2)
    middle, spread, mixed = np.empty(3), np.empty((3, 3)), np.empty((3, 2))
    for i in range(n):
        cost[i] = np.inf
        for a in range(3):
            middle[a] = 0.0
            for k in range(p):
                middle[a] += weight[k] * shapes[i, k, a]
            middle[a] /= total
        # Second moments: a view then costs as much as three landmarks, however many there are.
        spread[:] = 0.0
        mixed[:] = 0.0
        for k in range(p):
            ux, uy = at[k, 0] - bx, at[k, 1] - by
            for a in range(3):
                pa = weight[k] * (shapes[i, k, a] - middle[a])
                mixed[a, 0] += pa * ux
                mixed[a, 1] += pa * uy
                for b in range(a, 3):
                    spread[a, b] += pa * (shapes[i, k, b] - middle[b])
        for d in range(frames.shape[0]):
            f = frames[d]
            re, im, size = 0.0, 0.0, 1e-9
            for a in range(3):
                fx, fy = f[0, a], f[1, a]
                re += fx * mixed[a, 0] + fy * mixed[a, 1]
                im += fx * mixed[a, 1] - fy * mixed[a, 0]
                size += (fx * fx + fy * fy) * spread[a, a]
                for b in range(a + 1, 3):
                    size += 2.0 * (fx * f[0, b] + fy * f[1, b]) * spread[a, b]
            left = power - (re * re + im * im) / size
            # The base's axis points up in most pictures, down in some, aside in few.
            length = np.sqrt(re * re + im * im) + 1e-12
            zx, zy = f[0, 2], f[1, 2]
            up = -(im * zx + re * zy) / length
            left += upright_cost(up, np.sqrt(zx * zx + zy * zy))
            if left < cost[i]:
                cost[i] = left
                found[i, 0] = d
                found[i, 1] = re / size
                found[i, 2] = im / size
                cx, cy = found[i, 1], found[i, 2]
                gx = f[0, 0] * middle[0] + f[0, 1] * middle[1] + f[0, 2] * middle[2]
                gy = f[1, 0] * middle[0] + f[1, 1] * middle[1] + f[1, 2] * middle[2]
                found[i, 3] = bx - (cx * gx - cy * gy)
                found[i, 4] = by - (cx * gy + cy * gx)


@njit(cache=True, nogil=True, fastmath=True)
def upright_cost(up: float, length: float) -> float:
    """Twice the negative log of how usual it is that the base's axis points so.

    Args:
        up: upward component of the axis in the picture's plane, -1..1.
        length: of the axis in that plane.
    """
    aside = max(length * length - up * up, 0.0)
    return 12.0 * aside + (5.0 if up < 0.0 else 0.0)


@njit(cache=True, nogil=True)
def equations(
    R: Floats,
    t: Floats,
    q: Floats,
    chain: Poses,
    axis: Points,
    link: Ints,
    point: Points,
    at: Floats,
    whiten: Floats,
    limits: Floats,
    H: Floats,
    g: Floats,
) -> float:
    """Normal equations of a turn, a shift and the joints; returns the cost.

    The turn is about the base's origin in the camera's axes. Cost of a landmark: C^2 log(1 + r^2 /
    C^2) with r its whitened distance.

    Args:
        R: (3, 3) rotation of ``T_camera_base``.
        t: (3,) its translation [m].
        q: (n,) joints [rad].
        chain: ``T_link_joint`` of the robot.
        axis: (n, 3) of its joints.
        link: (m,) that carries each landmark.
        point: (m, 3) landmarks in their links [m].
        at: (m, 2) where they are seen.
        whiten: (m, 2, 2) square roots of the information.
        limits: (n, 2) of the joints [rad].
        H: (6 + n, 6 + n), written.
        g: (6 + n,), written.
    """
    n = q.shape[0]
    size = 6 + n
    T = chain_poses(q, chain, axis)
    H[:] = 0.0
    g[:] = 0.0
    cost = 0.0
    J = np.zeros((3, size))
    row = np.zeros((2, size))
    # All in the camera's axes, about the base's origin.
    turned = np.zeros((4, 4))
    turned[:3, :3] = R
    for L in range(n + 1):
        T[L] = compose(turned, T[L])
    screws = joint_screws(T, axis)
    carried = carried_points(T, link, point)
    for k in range(link.shape[0]):
        L = link[k]
        c0, c1, c2 = carried[k, 0], carried[k, 1], carried[k, 2]
        depth = c2 + t[2]
        if depth < 0.05:
            cost += CORE * CORE * np.log(1.0 + 1e6)
            continue
        x, y = (c0 + t[0]) / depth, (c1 + t[1]) / depth
        ex, ey = x - at[k, 0], y - at[k, 1]
        rx = whiten[k, 0, 0] * ex + whiten[k, 0, 1] * ey
        ry = whiten[k, 1, 0] * ex + whiten[k, 1, 1] * ey
        square = (rx * rx + ry * ry) / (CORE * CORE)
        cost += CORE * CORE * np.log(1.0 + square)
        weight = 1.0 / (1.0 + square)
        J[0, 1], J[0, 2] = c2, -c1
        J[1, 0], J[1, 2] = -c2, c0
        J[2, 0], J[2, 1] = c1, -c0
        J[0, 3], J[1, 4], J[2, 5] = 1.0, 1.0, 1.0
        for j in range(L):
            z0, z1, z2 = screws[j, 0], screws[j, 1], screws[j, 2]
            o0, o1, o2 = c0 - screws[j, 3], c1 - screws[j, 4], c2 - screws[j, 5]
            J[0, 6 + j] = z1 * o2 - z2 * o1
            J[1, 6 + j] = z2 * o0 - z0 * o2
            J[2, 6 + j] = z0 * o1 - z1 * o0
        # Joints beyond the link do not move it.
        moving = 6 + L
        inverse = 1.0 / depth
        for j in range(moving):
            dx = (J[0, j] - x * J[2, j]) * inverse
            dy = (J[1, j] - y * J[2, j]) * inverse
            row[0, j] = whiten[k, 0, 0] * dx + whiten[k, 0, 1] * dy
            row[1, j] = whiten[k, 1, 0] * dx + whiten[k, 1, 1] * dy
        for i in range(moving):
            g[i] += weight * (row[0, i] * rx + row[1, i] * ry)
            for j in range(i, moving):
                H[i, j] += weight * (row[0, i] * row[0, j] + row[1, i] * row[1, j])
    for j in range(n):
        over = max(q[j] - limits[j, 1], 0.0) + min(q[j] - limits[j, 0], 0.0)
        if over != 0.0:
            cost += (over / SLACK) ** 2
            g[6 + j] += over / SLACK**2
            H[6 + j, 6 + j] += 1.0 / SLACK**2
    for i in range(size):
        for j in range(i):
            H[i, j] = H[j, i]
    return cost


@njit(cache=True, nogil=True)
def refine(
    R: Floats,
    t: Floats,
    q: Floats,
    chain: Poses,
    axis: Points,
    link: Ints,
    point: Points,
    at: Floats,
    whiten: Floats,
    limits: Floats,
    hold: Floats,
    steps: int,
) -> float:
    """Levenberg and Marquardt's steps from a start, which is moved; returns the cost.

    Arguments as of :func:`equations`; hold: (6 + n,) what keeps each unknown where it is (the
    information of a prior about the current place, against what no landmark tells).
    """
    size = 6 + q.shape[0]
    H, g = np.zeros((size, size)), np.zeros(size)
    H2, g2 = np.zeros((size, size)), np.zeros(size)
    cost = equations(R, t, q, chain, axis, link, point, at, whiten, limits, H, g)
    damping = 1e-2
    for _ in range(steps):
        A = H.copy()
        for i in range(size):
            A[i, i] += damping * H[i, i] + hold[i]
        step = -np.linalg.solve(A, g)
        R2 = turn(step[:3]) @ R
        t2, q2 = t + step[3:6], q + step[6:]
        cost2 = equations(R2, t2, q2, chain, axis, link, point, at, whiten, limits, H2, g2)
        if cost2 < cost:
            gain = cost - cost2
            R[:], t[:], q[:] = R2, t2, q2
            H[:], g[:] = H2, g2
            cost = cost2
            damping = max(damping * 0.3, 1e-6)
            if gain < 1e-4 * (1.0 + cost):
                break
        else:
            damping *= 6.0
            if damping > 1e6:
                break
    return cost


@njit(cache=True, nogil=True)
def turn(w: Floats) -> Floats:
    """(3, 3) rotation by a vector (Rodrigues)."""
    angle = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    K = np.zeros((3, 3))
    K[0, 1], K[0, 2], K[1, 2] = -w[2], w[1], -w[0]
    K[1, 0], K[2, 0], K[2, 1] = w[2], -w[1], w[0]
    a = 1.0 - angle * angle / 6.0
    b = 0.5 - angle * angle / 24.0
    if angle > 1e-4:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / (angle * angle)
    return np.eye(3) + a * K + b * (K @ K)
