"""Compiled path cost: the length of every body sphere's motion, dearer where danger is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, JointPath, JointVector
from armsight.motion.body import Body
from armsight.motion.kernels import Scratch, body_motion

CALM_STEP = 0.1
"""Length of a step [m] of the fastest sphere where no voxel is dangerous."""
COARSE = 8.0
"""Steps are this many times longer while paths are compared than when a cost is told."""


class Danger(NamedTuple):
    """Danger by age, as kernels read it.

    Attributes:
        origin, voxel: of the grid.
        last_occupied: (nx, ny, nz) float32 [s].
        now: when danger is asked for [s].
        table: (k,) danger at ages 0, step, 2 step ...; 0 beyond.
        step: seconds between entries [s].
        calm: no voxel is dangerous.
    """

    origin: Floats
    voxel: float
    last_occupied: Floats32
    now: float
    table: Floats
    step: float
    calm: bool


@njit(cache=True, nogil=True)
def danger_at(danger: Danger, x: float, y: float, z: float) -> float:
    """Danger 0..1 of the voxel that holds a point; 0 outside the grid."""
    ix = int(np.floor((x - danger.origin[0]) / danger.voxel))
    iy = int(np.floor((y - danger.origin[1]) / danger.voxel))
    iz = int(np.floor((z - danger.origin[2]) / danger.voxel))
    nx, ny, nz = danger.last_occupied.shape
    if ix < 0 or iy < 0 or iz < 0 or ix >= nx or iy >= ny or iz >= nz:
        return 0.0
    seen = danger.last_occupied[ix, iy, iz]
    if seen == -np.inf:
        return 0.0
    x = max(danger.now - seen, 0.0) / danger.step
    k = int(x)
    if k + 1 >= danger.table.shape[0]:
        return 0.0
    f = x - k
    return danger.table[k] * (1.0 - f) + danger.table[k + 1] * f


@njit(cache=True, nogil=True)
def edge_cost(
    body: Body,
    danger: Danger,
    q0: JointVector,
    q1: JointVector,
    scratch: Scratch,
    coarse: float = 1.0,
) -> float:
    """Cost [m] of the straight joint motion: mean over spheres of the integral of (1 + danger).

    Midpoint rule on the spheres' speeds, in steps of about a voxel (a decimetre where nothing is
    dangerous), ``coarse`` times that.
    """
    m, n = body.lever.shape
    dq, q = scratch.dq, scratch.q
    for j in range(n):
        dq[j] = q1[j] - q0[j]
    fastest = 0.0
    for i in range(m):
        travel = 0.0
        for j in range(n):
            travel += body.lever[i, j] * abs(dq[j])
        fastest = max(fastest, travel)
    if fastest == 0.0:
        return 0.0
    steps = int(np.ceil(fastest / (coarse * (CALM_STEP if danger.calm else danger.voxel))))
    velocity, centers = scratch.velocity, scratch.centers
    total = 0.0
    for k in range(steps):
        s = (k + 0.5) / steps
        for j in range(n):
            q[j] = q0[j] + s * dq[j]
        body_motion(body, q, dq, scratch)
        for i in range(m):
            v = velocity[i]
            speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            if not danger.calm:
                c = centers[i]
                speed *= 1.0 + danger_at(danger, c[0], c[1], c[2])
            total += speed
    scratch.looks[0] += steps
    return total / (m * steps)


@njit(cache=True, nogil=True)
def path_cost_kernel(body: Body, danger: Danger, path: JointPath, scratch: Scratch) -> float:
    """Cost [m] of a (k, n) path."""
    total = 0.0
    for i in range(path.shape[0] - 1):
        total += edge_cost(body, danger, path[i], path[i + 1], scratch)
    return total
