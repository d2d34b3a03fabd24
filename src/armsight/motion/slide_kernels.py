"""A motion along what limits it, compiled: constraints of its parts, and the nearest motion."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointVector, Points, Poses


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
        for j in range(link[i]):
            T = poses[j + 1]
            ax = T[0, 0] * axis[j, 0] + T[0, 1] * axis[j, 1] + T[0, 2] * axis[j, 2]
            ay = T[1, 0] * axis[j, 0] + T[1, 1] * axis[j, 1] + T[1, 2] * axis[j, 2]
            az = T[2, 0] * axis[j, 0] + T[2, 1] * axis[j, 1] + T[2, 2] * axis[j, 2]
            px, py, pz = center[i, 0] - T[0, 3], center[i, 1] - T[1, 3], center[i, 2] - T[2, 3]
            rows[count, j] = (
                ux * (ay * pz - az * py) + uy * (az * px - ax * pz) + uz * (ax * py - ay * px)
            )
        bounds[count] = share[i] * closing
        count += 1
    return rows[:count], bounds[:count]


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
