"""Snapshots of made-up cells for the motion benchmarks: solids, and where things lately were."""

from __future__ import annotations

import numpy as np

from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.distance_field import DistanceField
from armsight.mapping.snapshot import FREE, OCCUPIED, VoxelGrid, WorkspaceSnapshot

LOWER, UPPER, VOXEL, CAP = (-1.2, -1.2, -0.3), (1.2, 1.2, 1.2), 0.02, 0.3


def box(center: tuple[float, float, float], size: tuple[float, float, float]) -> Solid:
    """An upright box [m]."""
    return Solid("box", "box", size, make_pose(None, center))


def ball(center: tuple[float, float, float], radius: float) -> Solid:
    """A ball [m]."""
    return Solid("ball", "sphere", (radius, 0.0, 0.0), make_pose(None, center))


def snapshot_of(solids: list[Solid], gone: list[tuple[Solid, float]] = ()) -> WorkspaceSnapshot:
    """Solids as occupied voxels; ``gone`` left so many seconds ago and leave danger only."""
    shape = tuple(round((b - a) / VOXEL) for a, b in zip(LOWER, UPPER))
    grid = VoxelGrid(np.array(LOWER), VOXEL, shape)
    centers = grid.center(np.stack(np.indices(shape), -1).reshape(-1, 3))
    state = np.full(len(centers), FREE, np.uint8)
    last = np.full(len(centers), -np.inf, np.float32)
    for solid, age in gone:
        last[solid.distance(centers) < 0.0] = 100.0 - age
    for solid in solids:
        state[solid.distance(centers) < 0.5 * np.sqrt(3.0) * VOXEL] = OCCUPIED
    state = state.reshape(shape)
    field = DistanceField(shape, VOXEL, CAP, counts_unknown=True).update(state)
    nothing = np.zeros((0, 3), np.float32)
    return WorkspaceSnapshot(
        1,
        100.0,
        100.0,
        grid,
        state,
        field,
        CAP,
        last.reshape(shape),
        nothing,
        0.5 * np.sqrt(3.0) * VOXEL,
        np.zeros(0, bool),
        nothing,
        (),
        (),
        True,
    )
