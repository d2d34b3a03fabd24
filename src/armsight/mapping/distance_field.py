"""A bounded Euclidean distance field with a proof: see ``docs/mapping.md``.

For every voxel: the exact distance between its cube and the nearest solid cube, capped. That is a
lower bound of the distance from any point of the voxel to any point of any solid voxel.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, Floats32, Mask
from armsight.mapping.kernels.field import changed_planes, pass_x, pass_zy


class DistanceField:
    """Keeps the field of a state grid up to date; redoes only the planes that can have changed.

    Args:
        shape: voxels along x, y, z.
        voxel: edge of a voxel [m].
        cap: distances saturate here [m]; rounded down to whole voxels, at most 15.
        counts_unknown: unknown voxels are solid beside occupied ones.
    """

    def __init__(
        self, shape: tuple[int, int, int], voxel: float, cap: float, counts_unknown: bool = False
    ) -> None:
        self.radius = min(int(round(cap / voxel, 6)), 15)
        if self.radius < 1:
            raise ValueError(f"a cap of {cap} m is less than a voxel of {voxel} m")
        self.cap = self.radius * voxel
        self._counts_unknown = counts_unknown
        squares = np.minimum(np.arange(256), self.radius**2)
        # float32 may round up; a proven bound may not
        self._table = np.nextafter((np.sqrt(squares) * voxel).astype(np.float32), np.float32(0))
        self._table[0] = 0.0
        nx, ny, nz = shape
        self._solid = np.zeros(shape, np.uint8)
        self._planes = np.full((nx, ny * (nz + self.radius)), self.radius**2, np.uint8)
        self._changed = np.zeros(nx, np.uint8)
        self._published = np.full(shape, self._table[self.radius**2], np.float32)
        self._published.flags.writeable = False

    def update(self, state: Bytes) -> Floats32:
        """(nx, ny, nz) float32 [m], read-only; the same array as before if nothing changed."""
        changed = self._changed
        if changed_planes(state, self._solid, self._counts_unknown, changed):
            pass_zy(self._solid, changed, self.radius, self._planes)
            out = np.empty(self._solid.shape, np.float32)
            pass_x(self._planes, changed, self.radius, self._table, self._published, out)
            out.flags.writeable = False
            self._published = out
        return self._published


def bounded_distance(solid: Mask | Bytes, voxel: float, cap: float) -> Floats32:
    """The field of one (nx, ny, nz) mask of solid voxels, from scratch.

    Args:
        solid: true where a voxel is solid.
        voxel: its edge [m].
        cap: see :class:`DistanceField`.
    """
    mask = np.asarray(solid)
    field = DistanceField((mask.shape[0], mask.shape[1], mask.shape[2]), voxel, cap)
    return field.update(np.where(mask, np.uint8(2), np.uint8(1)))
