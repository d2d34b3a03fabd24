"""A motion along what limits it, compiled: constraints of its parts, and the nearest motion."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointVector, Points, Poses
from armsight.motion.body import Body
from armsight.motion.kernels import pair_gap


@njit(cache=True, nogil=True)
def limiting_rows(
    poses: Poses,
    axis: Points,
    link: Ints,
    center: Points,
    velocity: Points,
    share: Floats,
    hazard: Points,
    tight: Ints,
) -> tuple[Points, Floats]:
    """Rows and bounds that hold spheres to what limits them: ``rows @ q' <= bounds``.

    A row is the closing speed of a sphere towards its most limiting hazard by each joint's speed;
    its bound is the share that is allowed of the present one. Spheres that do not close in have
    none.

    Args:
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        link: (m,) that carries each sphere.
        center: (m, 3) of the spheres [m].
        velocity: (m, 3) of the spheres [m/s].
        share: (m,) of the motion that is allowed.
        hazard: (k, 3) what limits each of the tight spheres [m].
        tight: (k,) spheres to look at.
    """
    n = axis.shape[0]
    rows, bounds = np.zeros((tight.shape[0], n)), np.empty(tight.shape[0])
    count = 0
    for k in range(tight.shape[0]):
        i = tight[k]
        ux = hazard[k, 0] - center[i, 0]
        uy = hazard[k, 1] - center[i, 1]
        uz = hazard[k, 2] - center[i, 2]
        length = max(np.sqrt(ux * ux + uy * uy + uz * uz), 1e-9)
        ux, uy, uz = ux / length, uy / length, uz / length
        closing = velocity[i, 0] * ux + velocity[i, 1] * uy + velocity[i, 2] * uz
        if closing <= 0.0:
            continue
        _row(poses, axis, 0, link[i], center[i], ux, uy, uz, rows[count])
        bounds[count] = share[i] * closing
        count += 1
    return rows[:count], bounds[:count]


@njit(cache=True, nogil=True)
def own_rows(
    body: Body, poses: Poses, axis: Points, centers: Points, later: Points, near: float
) -> tuple[Points, Floats, Ints]:
    """How fast links that are near each other come together: ``rows @ q'`` [m/s].

    Of any two links the two spheres count that are nearest to each other, now or later.

    Args:
        body: whose spheres may touch each other.
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        centers: (m + f, 3) of the spheres, and of those that never move [m].
        later: the same at another time.
        near: pairs that are farther apart have no row [m].

    Returns:
        (k, n) rows [m/rad], (k,) the lesser gaps [m], and the links of each (k, 2).
    """
    groups, n = body.groups.shape[0], axis.shape[0]
    rows, gaps = np.zeros((groups, n)), np.empty(groups)
    links = np.empty((groups, 2), np.int64)
    count = 0
    for g in range(groups):
        a, b = body.groups[g, 2], body.groups[g, 3]
        need = body.group_reach[g] + near
        dx = centers[b, 0] - centers[a, 0]
        dy = centers[b, 1] - centers[a, 1]
        dz = centers[b, 2] - centers[a, 2]
        if dx * dx + dy * dy + dz * dz >= need * need:
            continue
        best, pair = near, -1
        for p in range(body.groups[g, 4], body.groups[g, 5]):
            gap = min(pair_gap(body, centers, p), pair_gap(body, later, p))
            if gap < best:
                best, pair = gap, p
        if pair < 0:
            continue
        a, b = body.pairs[pair, 0], body.pairs[pair, 1]
        links[count, 0], links[count, 1] = body.groups[g, 0], body.groups[g, 1]
        ux = centers[a, 0] - centers[b, 0]
        uy = centers[a, 1] - centers[b, 1]
        uz = centers[a, 2] - centers[b, 2]
        length = max(np.sqrt(ux * ux + uy * uy + uz * uz), 1e-9)
        ux, uy, uz = ux / length, uy / length, uz / length
        first, last = links[count, 0], links[count, 1]  # joints before both move both alike
        _row(poses, axis, first, last, centers[b], ux, uy, uz, rows[count])
        gaps[count] = best
        count += 1
    return rows[:count], gaps[:count], links[:count]


@njit(cache=True, nogil=True)
def _row(
    poses: Poses,
    axis: Points,
    first: int,
    last: int,
    point: Floats,
    ux: float,
    uy: float,
    uz: float,
    row: Floats,
) -> None:
    """Write how fast a point (3,) moves along a unit vector by each of the joints first..last."""
    for j in range(first, last):
        T = poses[j + 1]
        ax = T[0, 0] * axis[j, 0] + T[0, 1] * axis[j, 1] + T[0, 2] * axis[j, 2]
        ay = T[1, 0] * axis[j, 0] + T[1, 1] * axis[j, 1] + T[1, 2] * axis[j, 2]
        az = T[2, 0] * axis[j, 0] + T[2, 1] * axis[j, 1] + T[2, 2] * axis[j, 2]
        px, py, pz = point[0] - T[0, 3], point[1] - T[1, 3], point[2] - T[2, 3]
        row[j] = ux * (ay * pz - az * py) + uy * (az * px - ax * pz) + uz * (ax * py - ay * px)


@njit(cache=True, nogil=True)
def project(wanted: JointVector, rows: Points, bounds: Floats, sweeps: int) -> JointVector:
    """The motion nearest to a wanted one with ``rows @ motion <= bounds`` (Hildreth's method).

    Args:
        wanted: (n,) motion.
        rows: (k, n) constraints.
        bounds: (k,) of them.
        sweeps: over all rows; few suffice for few rows.
    """
    x = wanted.copy()
    k, n = rows.shape
    dual = np.zeros(k)
    for _ in range(sweeps):
        for i in range(k):
            square = 0.0
            excess = -bounds[i]
            for j in range(n):
                square += rows[i, j] * rows[i, j]
                excess += rows[i, j] * x[j]
            if square <= 1e-12:
                continue
            step = max(excess / square, -dual[i])
            dual[i] += step
            for j in range(n):
                x[j] -= step * rows[i, j]
    return x
