"""Where someone unseen could be: a set that grows through unseen space and shrinks by sight.

A person comes from outside the observed space or is part of something seen. Nobody appears in a
pocket of unseen space that seen free space and declared solids enclose, such as the arm's shadow;
nor in one too small for a hand. So the set of possible places begins at the outside and at
everything seen that is not declared, spreads from there through space that is not seen free, at
most as fast as a person moves, and loses whatever is seen free.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, Ints32
from armsight.mapping.kernels.flood import (
    add_voxels,
    fill_rim,
    frontier,
    grow,
    intersect,
    open_by_cube,
    pack,
    pack_room,
    unpack,
)
from armsight.mapping.snapshot import VoxelGrid


class UnseenPeople:
    """The set of voxels that could hide someone.

    Args:
        grid: the grid; static: (nx, ny, nz) uint8 voxels filled by declared solids.
        speed: how fast someone may move [m/s].
        hand: edge of the smallest cube that can hold a part of a person [m].
    """

    def __init__(self, grid: VoxelGrid, static: Bytes, speed: float, hand: float) -> None:
        self._grid = grid
        self._static = np.ascontiguousarray(static).reshape(grid.shape)
        self._speed = speed
        self._edge = max(int(np.floor(hand / grid.voxel + 1e-9)), 1)
        self._rim = self._edge
        nx, ny, nz = grid.shape
        self._depth = nz + 2 * self._rim
        shape = (nx + 2 * self._rim, ny + 2 * self._rim, (self._depth + 63) // 64)
        self._possible = np.zeros(shape, np.uint64)
        self._room = np.zeros(shape, np.uint64)
        self._a = np.zeros(shape, np.uint64)
        self._b = np.zeros(shape, np.uint64)
        self._solid = np.zeros(shape, np.uint64)
        pack(self._static, self._rim, self._solid)
        self._indices = np.empty(nx * ny * nz, np.int32)
        self._owed = 0.0
        self._begun = False

    def update(self, state: Bytes, dynamic: Ints32, body: Bytes, elapsed: float) -> Ints32:
        """(m,) flat indices of the outermost voxels that could hide someone.

        Args:
            state: (nx, ny, nz) state of the voxels.
            dynamic: flat indices of voxels occupied by something undeclared.
            body: (nx, ny, nz) uint8, 1 where the arm itself is.
            elapsed: time since the last update [s].
        """
        nx, ny, nz = self._grid.shape
        blocked = self._static | body.reshape(self._grid.shape)
        pack_room(state, blocked, self._rim, self._room)
        open_by_cube(self._room, self._edge, self._depth)
        intersect(self._possible, self._room)
        fill_rim(self._rim, self._depth, self._possible)
        add_voxels(dynamic, len(dynamic), ny, nz, self._rim, self._possible)
        if self._begun:
            self._owed += self._speed * max(elapsed, 0.0) / self._grid.voxel
            steps = int(self._owed)
            self._owed -= steps
        else:
            steps = nx + ny + nz
            self._begun = True
        for _ in range(steps):
            if not grow(self._possible, self._room, self._a, self._b):
                break
        count = frontier(self._possible, self._solid, self._rim, ny, nz, self._indices)
        return self._indices[:count]

    def mask(self) -> Bytes:
        """(nx, ny, nz) uint8, 1 where someone unseen (or seen) could be."""
        out = np.zeros(self._grid.shape, np.uint8)
        unpack(self._possible, self._rim, out)
        return out
