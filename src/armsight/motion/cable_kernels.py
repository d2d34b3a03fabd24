"""Compiled looks at a hung cable on planned motions: whether it comes to things that are there.

It is taken as it hangs still (:mod:`armsight.robots.cable_kernels`), in spheres, among coarse cubes
of which some fine voxel is occupied. A motion is looked at in steps, not proven: how far a cable
moves with its end has no useful bound where it is nearly taut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointVector, Points, Poses
from armsight.mapping.snapshot import OCCUPIED
from armsight.robots.cable_kernels import hang
from armsight.robots.kernels import chain_poses

STEP = 0.08
"""The cable's end moves by no more than this between two looks [m]: less than a sphere's radius."""
COST = 2
"""Looks of the arm's body that a look at the cable counts as: it takes about as long."""


class CableWay(NamedTuple):
    """A cable and what it must not come to.

    Attributes:
        T_link_joint: (n, 4, 4); axis: (n, 3); of the arm, as in :class:`.Robot`.
        root: (3,) where the cable leaves the tool, in the last link's frame [m].
        lever: (n,) bound of the root's distance from each joint's axis [m].
        hanger: (3,) where it hangs, in ``base`` [m].
        length: of it [m].
        radius: (k,) of its spheres, its end's first [m]; none of 0 touches anything, and (0,) is no
            cable.
        origin: (3,) lower corner of the coarse cubes in ``base`` [m]; edge: of one [m].
        solid: (nx, ny, nz) bool, the cubes that hold something.
    """

    T_link_joint: Poses
    axis: Points
    root: Floats
    lever: Floats
    hanger: Floats
    length: float
    radius: Floats
    origin: Floats
    edge: float
    solid: np.ndarray


NO_CABLE = CableWay(
    np.zeros((0, 4, 4)),
    np.zeros((0, 3)),
    np.zeros(3),
    np.zeros(0),
    np.zeros(3),
    0.0,
    np.zeros(0),
    np.zeros(3),
    1.0,
    np.zeros((0, 0, 0), bool),
)


@njit(cache=True, nogil=True)
def coarsened(state: np.ndarray, factor: int) -> np.ndarray:
    """Coarse cubes, ``factor`` voxels wide, that hold an occupied voxel."""
    nx, ny, nz = state.shape
    out = np.zeros((-(-nx // factor), -(-ny // factor), -(-nz // factor)), np.bool_)
    for i in range(nx):
        for j in range(ny):
            held = 0
            for k in range(nz):  # many voxels at once; most rows hold nothing
                held += state[i, j, k] == OCCUPIED
            if held == 0:
                continue
            row = out[i // factor, j // factor]
            for k in range(nz):
                if state[i, j, k] == OCCUPIED:
                    row[k // factor] = True
    return out


@njit(cache=True, nogil=True)
def cable_centers(way: CableWay, q: JointVector, out: Points) -> None:
    """Write the (k, 3) middles of a still cable's pieces in ``base`` at (n,) positions [m]."""
    T = chain_poses(q, way.T_link_joint, way.axis)[q.shape[0]]
    end = T[:3, 3].copy()
    for r in range(3):
        for c in range(3):
            end[r] += T[r, c] * way.root[c]
    k = out.shape[0]
    points = np.empty((k + 1, 3))
    hang(end, way.hanger, way.length, points)
    for i in range(k):
        for c in range(3):
            out[i, c] = 0.5 * (points[i, c] + points[i + 1, c])


@njit(cache=True, nogil=True)
def room_about(way: CableWay, x: float, y: float, z: float, limit: float) -> float:
    """Distance [m] of a point from the nearest solid cube; ``limit`` where none is nearer."""
    nx, ny, nz = way.solid.shape
    gx = (x - way.origin[0]) / way.edge
    gy = (y - way.origin[1]) / way.edge
    gz = (z - way.origin[2]) / way.edge
    reach = limit / way.edge
    best = reach * reach
    for i in range(max(0, int(np.floor(gx - reach))), min(nx - 1, int(np.floor(gx + reach))) + 1):
        dx = max(i - gx, gx - i - 1.0, 0.0)
        for j in range(
            max(0, int(np.floor(gy - reach))), min(ny - 1, int(np.floor(gy + reach))) + 1
        ):
            dy = max(j - gy, gy - j - 1.0, 0.0)
            if dx * dx + dy * dy >= best:
                continue
            for k in range(
                max(0, int(np.floor(gz - reach))), min(nz - 1, int(np.floor(gz + reach))) + 1
            ):
                if way.solid[i, j, k]:
                    dz = max(k - gz, gz - k - 1.0, 0.0)
                    best = min(best, dx * dx + dy * dy + dz * dz)
    return limit if best >= reach * reach else np.sqrt(best) * way.edge


@njit(cache=True, nogil=True)
def cable_touches(way: CableWay, q: JointVector, centers: Points) -> bool:
    """Whether the cable comes to something at (n,) positions; (k, 3) is working memory."""
    cable_centers(way, q, centers)
    for i in range(way.radius.shape[0]):
        r = way.radius[i]
        if r > 0.0 and room_about(way, centers[i, 0], centers[i, 1], centers[i, 2], r) < r:
            return True
    return False


@njit(cache=True, nogil=True)
def cable_free(way: CableWay, q0: JointVector, q1: JointVector, looks: Ints) -> bool:
    """Whether the cable comes to nothing on the straight motion between (n,) positions.

    Args:
        way: the cable among things.
        q0: begin.
        q1: end.
        looks: (1,) counts the work, see :data:`COST`.
    """
    if way.radius.shape[0] == 0:
        return True
    n = q0.shape[0]
    travel = 0.0
    for j in range(n):
        travel += way.lever[j] * abs(q1[j] - q0[j])
    steps = max(int(np.ceil(travel / STEP)), 1)
    q, centers = np.empty(n), np.empty((way.radius.shape[0], 3))
    for s in range(steps + 1):
        looks[0] += COST
        for j in range(n):
            q[j] = q0[j] + s / steps * (q1[j] - q0[j])
        if cable_touches(way, q, centers):
            return False
    return True
