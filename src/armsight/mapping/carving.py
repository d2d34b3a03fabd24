"""What one camera saw through: the search itself, or what is left of it for a camera at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats, Ints32, Pose, Shorts
from armsight.mapping.kernels.carve import carve
from armsight.mapping.kernels.carve_plan import (
    CUBE,
    MOST_VOXELS,
    ROW,
    carve_as_planned,
    plan_carving,
)
from armsight.mapping.lens import DepthLens
from armsight.mapping.snapshot import VoxelGrid

Lanes = tuple[NDArray[np.uint32], Bytes, Shorts, Shorts, Shorts, Ints32]
Plan = tuple[Ints32, Ints32, NDArray[np.uint32], Lanes]
"""Cubes, halves, blocks and lanes, see ``kernels/carve_plan.py``."""

MOST_PLANNED = 4_000_000
"""Voxels up to which a grid is worth a plan: it takes about 7 bytes a voxel and camera."""


class Carver:
    """Finds the voxels of one grid that one camera's images saw through.

    A camera at rest is recognised by two frames from one pose; from then on it goes by a plan,
    with the same result in half the time.

    Args:
        lens: of the camera.
        grid: of the voxels.
        near: the camera's least distance [m].
        noise: (3,) a, b, c of its sigma(z) = a + b z + c z^2 [m].
        sigmas: how much of it must lie behind a free voxel.
    """

    def __init__(
        self, lens: DepthLens, grid: VoxelGrid, near: float, noise: Floats, sigmas: float = 1.0
    ) -> None:
        self._lens = lens
        self._grid = np.asarray(grid.origin, float), float(grid.voxel), np.asarray(grid.shape)
        self._size = int(np.prod(grid.shape))
        self._eye = near, np.asarray(noise, float), sigmas
        self._seen_from = b""
        self._plan: Plan | None = None
        self._room = (0, 0, 0, 0)
        self._can_plan = self._size <= MOST_PLANNED and max(grid.shape) <= MOST_VOXELS

    @property
    def planned(self) -> bool:
        """Whether the camera is known to be at rest."""
        return self._plan is not None

    def carve(self, T: Pose, free: Bytes) -> None:
        """Say what the image that the lens has tabulated saw through.

        Args:
            T: camera in ``base``.
            free: (voxels,) uint8, overwritten: 1 where it saw through the whole voxel.
        """
        free.fill(0)
        lens = self._lens
        shaped = free.reshape(self._grid[2])
        seen_from = T.tobytes()
        if seen_from != self._seen_from:
            self._seen_from, self._plan = seen_from, None
        elif self._plan is None and self._can_plan:
            self._plan = self._make_plan(T)
        if self._plan is not None:
            carve_as_planned(lens.least, lens.nearness, *self._plan, shaped)
        else:
            image = lens.least, lens.nearness, lens.units, lens.ideal
            carve(*image, T, *self._grid, *self._eye, shaped)

    def _make_plan(self, T: Pose) -> Plan | None:
        lens = self._lens
        h, w = lens.least.shape[1:]
        eye = h, w, lens.units, lens.ideal, T, *self._grid, *self._eye
        plan = _room(*self._room)
        counts = plan_carving(*eye, *plan)
        if counts[0] < 0:
            self._can_plan = False
            return None
        if any(n > room for n, room in zip(counts, self._room)):
            self._room = counts
            plan = _room(*counts)
            plan_carving(*eye, *plan)
        cubes, halves, blocks, lanes = plan
        return cubes[: counts[0]], halves[: counts[1]], blocks, lanes


def _room(cubes: int, halves: int, blocks: int, lanes: int) -> Plan:
    """An empty plan with room for so many of each."""
    return (
        np.empty((cubes, CUBE), np.int32),
        np.empty((halves, CUBE), np.int32),
        np.empty((blocks, ROW), np.uint32),
        (
            np.empty(lanes, np.uint32),
            np.empty(lanes, np.uint8),
            np.empty(lanes, np.uint16),
            np.empty(lanes, np.uint16),
            np.empty(lanes, np.uint16),
            np.empty(lanes, np.int32),
        ),
    )
