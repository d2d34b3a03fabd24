"""A distance field of all that is not seen free, for snapshots whose own leaves unknown out."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt

from armsight.arrays import Floats32
from armsight.mapping.snapshot import FREE, WorkspaceSnapshot


def distance_to_solid(snapshot: WorkspaceSnapshot) -> Floats32:
    """(nx, ny, nz) bound [m] of the distance from any point of a voxel to any voxel not free."""
    return _cached(_Key(snapshot))


class _Key:
    """A snapshot as a cache key: the very object, as its arrays never change."""

    def __init__(self, snapshot: WorkspaceSnapshot) -> None:
        self.snapshot = snapshot

    def __hash__(self) -> int:
        return id(self.snapshot)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.snapshot is self.snapshot


@lru_cache(maxsize=2)
def _cached(key: _Key) -> Floats32:
    snapshot = key.snapshot
    solid = snapshot.state != FREE
    if not solid.any():
        return np.full(solid.shape, snapshot.distance_cap, np.float32)
    near = binary_dilation(solid, np.ones((3, 3, 3), bool))
    field = distance_transform_edt(~near) * snapshot.grid.voxel
    return np.minimum(field, snapshot.distance_cap).astype(np.float32)
