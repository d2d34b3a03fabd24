"""Where a part of somebody could be above the mapped box, where no camera looks.

Nobody floats: whoever is above the box stands on the floor and reaches out of it, so they cross its
top somewhere, and there they are seen, or are in unseen space that hangs together with what is seen
of them. From there to their fingertip is no farther than ``MappingConfig.reach``. So the lid of the
box is a place of people within that distance of every place where they could cross it, and nowhere
else. What of them is higher is farther from the arm than the lid below it.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats32, Mask, Vector3
from armsight.mapping.config import MappingConfig
from armsight.mapping.hazards import Lid, UnseenPeople
from armsight.mapping.layers import far_grid
from armsight.mapping.snapshot import VoxelGrid

BELOW = 0.02
"""The lid's points lie this far under it [m]: cells are wider than the cubes of hazards."""


class Overhead:
    """The lid of one map, in cells as wide as the coarse layer's voxels.

    Args:
        fine: the fine grid.
        config: settings of its map; without a coarse layer there is no lid.

    Attributes:
        axis: of ``base`` that points up or down; upwards: whether up.
        steps: cells that a part above the lid may be long.
        cells: the lid: a grid one voxel thick along ``axis``; its voxels lie above the box.
    """

    def __init__(self, fine: VoxelGrid, config: MappingConfig) -> None:
        self.axis, self.upwards = upright(np.asarray(config.up))
        around = far_grid(config, fine)
        origin, shape = np.array(around.origin, float), list(around.shape)
        ends = float(fine.origin[self.axis]), fine.shape[self.axis] * fine.voxel
        self._height = ends[0] + ends[1] if self.upwards else ends[0]
        origin[self.axis] = self._height if self.upwards else self._height - around.voxel
        shape[self.axis] = 1
        self.cells = VoxelGrid(origin, around.voxel, (shape[0], shape[1], shape[2]))
        steps = int(np.ceil(config.reach / around.voxel)) + 1
        self.steps = steps if config.reach > 0.0 else 0

    def lid(self, unseen: UnseenPeople) -> Lid:
        """The same for the set of the coarse layer."""
        return unseen.lid(self.axis, self.upwards, self.steps)

    def points(self, there: Mask) -> Floats32:
        """(m, 3) points [m] that stand for those of the lid's cells (a, b) that are true."""
        index = np.stack(np.unravel_index(np.flatnonzero(there), self.cells.shape), axis=1)
        points = self.cells.center(index).astype(np.float32)
        points[:, self.axis] = self._height + (-BELOW if self.upwards else BELOW)
        return points


def upright(up: Vector3) -> tuple[int, bool]:
    """The axis of ``base`` nearest to the vertical (3,), and whether it points up."""
    axis = int(np.argmax(np.abs(up)))
    return axis, bool(up[axis] > 0.0)
