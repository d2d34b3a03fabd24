"""A bounded Euclidean distance field with a proof: see ``docs/mapping.md``.

For every voxel: the exact distance between its cube and the nearest solid cube, capped. That is a
lower bound of the distance from any point of the voxel to any point of any solid voxel.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, Floats32, Mask
from armsight.mapping.kernels.field import changed_columns, pass_xy, pass_z, to_metres, widen


class DistanceField:
    """Keeps the field of a state grid up to date; redoes only the columns that can have changed.

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
        self._solid = np.zeros(shape, np.uint8)
        full = self.radius**2
        self._squares = [np.full(shape, full, np.uint8) for _ in range(3)]
        self._busy = [np.zeros(shape[:2], np.uint8) for _ in range(3)]
        self._flags = [np.zeros(shape[:2], np.uint8) for _ in range(3)]
        self._metres = np.full(shape, self._table[full], np.float32)
        self._published: Floats32 | None = None

    def update(self, state: Bytes) -> Floats32:
        """(nx, ny, nz) float32 [m], read-only; the same array as before if nothing changed."""
        a, b, c = self._flags
        if changed_columns(state, self._solid, self._counts_unknown, a) or self._published is None:
            widen(a, self.radius, 1, b)
            widen(b, self.radius, 0, c)
            g1, g2, g3 = self._squares
            pass_z(self._solid, a, self.radius, g1, self._busy[0])
            pass_xy(g1, self._busy[0], b, self.radius, 1, g2, self._busy[1])
            pass_xy(g2, self._busy[1], c, self.radius, 0, g3, self._busy[2])
            to_metres(g3, c, self._table, self._metres)
            self._published = self._metres.copy()
            self._published.flags.writeable = False
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
