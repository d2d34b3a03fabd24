"""Where a part of somebody could be above the mapped box, where no camera looks.

Nobody floats: whoever is above the box stands on the floor and reaches out of it, so they cross its
top somewhere, and there they are seen, or are in unseen space that hangs together with where people
come from. From there to their fingertip is no farther than ``MappingConfig.reach``. So the lid of
the box is a place of people within that distance of every place where somebody could cross it, and
nowhere else. What of them is higher is farther from the arm than the lid below it. A declared solid
that stands half of ``reach`` above the lid is not reached over: the way up and down is too long.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import label

from armsight.arrays import Floats32, Mask
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.hazards import Lid, UnseenPeople
from armsight.mapping.layers import far_grid
from armsight.mapping.snapshot import VoxelGrid
from armsight.mapping.static_geometry import overlaps

BELOW = 0.02
"""The lid's points lie this far under it [m]: cells are wider than the cubes of hazards."""


class Overhead:
    """The lid of one map, in cells as wide as the coarse layer's voxels.

    Args:
        fine: the fine grid.
        config: settings of its map; without a coarse layer there is no lid.
        solids: declared, in ``base``.

    Attributes:
        axis: of ``base`` that points up or down; upwards: whether up.
        steps: cells that a part above the lid may be long.
        cells: the lid: a grid one voxel thick along ``axis``; its voxels lie above the box.
        open: (a, b) over the two other axes, those cells where an arm could be.
    """

    def __init__(self, fine: VoxelGrid, config: MappingConfig, solids: Sequence[Solid]) -> None:
        up = np.asarray(config.up)
        self.axis = int(np.argmax(np.abs(up)))
        self.upwards = bool(up[self.axis] > 0.0)
        around = far_grid(config, fine)
        origin, shape = np.array(around.origin, float), list(around.shape)
        ends = float(fine.origin[self.axis]), fine.shape[self.axis] * fine.voxel
        self._height = ends[0] + ends[1] if self.upwards else ends[0]
        origin[self.axis] = self._height if self.upwards else self._height - around.voxel
        shape[self.axis] = 1
        self.cells = VoxelGrid(origin, around.voxel, (shape[0], shape[1], shape[2]))
        self._fine = fine
        self._reach = reach = config.reach
        self.steps = int(np.ceil(reach / around.voxel)) + 1 if reach > 0.0 else 0
        self.redeclare(solids)

    def redeclare(self, solids: Sequence[Solid]) -> None:
        """Other solids are declared: what stands high enough above the lid keeps arms out."""
        every = np.indices(self.cells.shape).reshape(3, -1).T
        centers, voxel = self.cells.center(every), self.cells.voxel
        higher = np.zeros(3)
        higher[self.axis] = 0.5 * self._reach * (1.0 if self.upwards else -1.0)
        tall = np.zeros(len(every), bool)
        for solid in solids:
            tall |= overlaps(solid, centers, voxel) & overlaps(solid, centers + higher, voxel)
        open_ = ~tall.reshape(self._plane)
        # Walls around the cell: who is outside of them reaches nothing above the box.
        names, _ = label(open_)
        low = self.cells.index(self._fine.center(np.zeros((1, 3), int)))[0]
        high = self.cells.index(self._fine.center(np.array([self._fine.shape]) - 1))[0]
        over = tuple(slice(low[a], high[a] + 1) for a in range(3) if a != self.axis)
        self.open = np.isin(names, np.setdiff1d(names[over], [0]))

    @property
    def _plane(self) -> tuple[int, int]:
        first, second = (n for a, n in enumerate(self.cells.shape) if a != self.axis)
        return first, second

    def lid(self, unseen: UnseenPeople) -> Lid:
        """The same for the set of the coarse layer."""
        return unseen.lid(self.axis, self.upwards, self.steps, self.open)

    def points(self, there: Mask) -> Floats32:
        """(m, 3) points [m] that stand for those of the lid's cells (a, b) that are true."""
        index = np.stack(np.unravel_index(np.flatnonzero(there), self.cells.shape), axis=1)
        points = self.cells.center(index).astype(np.float32)
        points[:, self.axis] = self._height + (-BELOW if self.upwards else BELOW)
        return points
