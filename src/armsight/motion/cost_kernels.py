"""Compiled path cost: the length of every body sphere's motion, dearer where danger is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, JointPath, JointVector, Points
from armsight.motion.body import Body
from armsight.motion.kernels import body_centers

CALM_STEP = 0.1
"""Length of a step [m] of the fastest sphere where no voxel is dangerous."""


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


class CostScratch(NamedTuple):
    """Working memory: two (m, 3) sets of centres, (n,) joints, and a counter of looks."""

    before: Points
    after: Points
    q: JointVector
    looks: np.ndarray


def make_cost_scratch(body: Body) -> CostScratch:
    """Working memory for one thread."""
    m, n = body.lever.shape
    return CostScratch(np.zeros((m, 3)), np.zeros((m, 3)), np.zeros(n), np.zeros(1, np.int64))


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
    body: Body, danger: Danger, q0: JointVector, q1: JointVector, scratch: CostScratch
) -> float:
    """Cost [m] of the straight joint motion: mean over spheres of the integral of (1 + danger)."""
    m, n = body.lever.shape
    fastest = 0.0
    for i in range(m):
        travel = 0.0
        for j in range(n):
            travel += body.lever[i, j] * abs(q1[j] - q0[j])
        fastest = max(fastest, travel)
    if fastest == 0.0:
        return 0.0
    step = CALM_STEP if danger.calm else danger.voxel
    steps = int(np.ceil(fastest / step))
    before, after, q = scratch.before, scratch.after, scratch.q
    total = 0.0
    body_centers(body, q0, before)
    for k in range(1, steps + 1):
        for j in range(n):
            q[j] = q0[j] + (k / steps) * (q1[j] - q0[j])
        body_centers(body, q, after)
        for i in range(m):
            dx = after[i, 0] - before[i, 0]
            dy = after[i, 1] - before[i, 1]
            dz = after[i, 2] - before[i, 2]
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            if danger.calm:
                total += length
            else:
                total += length * (
                    1.0
                    + danger_at(
                        danger,
                        0.5 * (after[i, 0] + before[i, 0]),
                        0.5 * (after[i, 1] + before[i, 1]),
                        0.5 * (after[i, 2] + before[i, 2]),
                    )
                )
        before, after = after, before
    scratch.looks[0] += steps
    return total / m


@njit(cache=True, nogil=True)
def path_cost_kernel(body: Body, danger: Danger, path: JointPath, scratch: CostScratch) -> float:
    """Cost [m] of a (k, n) path."""
    total = 0.0
    for i in range(path.shape[0] - 1):
        total += edge_cost(body, danger, path[i], path[i + 1], scratch)
    return total
