"""The two grids of a map: fine voxels where the arm can reach, coarse ones around them."""

from __future__ import annotations

import numpy as np

from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import VoxelGrid

NOWHERE = 1e6
"""Where a switched-off layer lies [m]: nothing is ever seen there."""


def fine_grid(config: MappingConfig) -> VoxelGrid:
    """The fine grid; its upper corner is rounded up to a whole voxel."""
    lower, upper = np.asarray(config.lower, float), np.asarray(config.upper, float)
    counts = np.ceil((upper - lower) / config.voxel - 1e-6).astype(int)
    return VoxelGrid(lower, config.voxel, (int(counts[0]), int(counts[1]), int(counts[2])))


def far_grid(config: MappingConfig, fine: VoxelGrid) -> VoxelGrid:
    """The coarse grid around the fine one, larger by ``far_lower`` and ``far_upper``.

    It holds the fine grid wholly. Without margins it is a single voxel far away.
    """
    voxel = config.far_parts * config.voxel
    if not config.has_far_layer:
        return VoxelGrid(np.full(3, NOWHERE), voxel, (1, 1, 1))
    steps = np.ceil(np.asarray(config.far_lower) / voxel - 1e-6)
    origin = np.asarray(fine.origin) - steps * voxel
    top = (
        np.asarray(fine.origin) + np.asarray(fine.shape) * fine.voxel + np.asarray(config.far_upper)
    )
    counts = np.ceil((top - origin) / voxel - 1e-6).astype(int)
    return VoxelGrid(origin, voxel, (int(counts[0]), int(counts[1]), int(counts[2])))
