"""The evidence of all cameras about the voxels of one grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Ints32, Mask, Points, Pose, Shorts
from armsight.mapping.kernels.evidence import (
    add_hits,
    add_looks,
    clear_seen_through,
    compose_state,
    keep_clusters,
)
from armsight.mapping.static_geometry import StaticGeometry

LOOKS = 8
"""Looks at an occupied voxel that must find nothing ..."""
FORGET = 0.5
"""... and for how long [s], before an unconfirmed sighting is withdrawn."""
DEEP = 0.06
"""What was seen this much deeper inside of a solid [m] than it is declared coarsely was not it."""


class Sight(NamedTuple):
    """A depth image through an ideal lens, for looking up single places.

    Attributes:
        image: (h, w) uint16, ``units`` a metre; 0 where there is no return.
        units: depth units a metre.
        lens: (4,) fx fy cx cy.
        T: camera in ``base``.
        near: the camera's least depth [m].
        noise: (3,) a, b, c of its sigma(z) = a + b z + c z^2 [m].
        tolerance: (m, rad, sigmas): so far from a declared surface a return may show it.
    """

    image: Shorts
    units: float
    lens: Floats
    T: Pose
    near: float
    noise: Floats
    tolerance: tuple[float, float, float]


class Occupancy:
    """What is free, occupied and unknown, and by whose word.

    * Free: the newest frame of a living camera saw through the whole voxel.
    * Occupied: a frame hit it with enough pixels, or two frames with few; until seen through, or
      until it was looked at for a while and nothing hit it again.
    * Unknown: neither. A camera that dies takes its free voxels with it; never its occupied ones.

    Attributes:
        grid: the grid; declared: the declared solids on it.
        free: (cameras, voxels) uint8, 1 where the newest frame of a camera saw through.
        occupied: (voxels,) uint8, 1 where something undeclared was seen.
    """

    def __init__(
        self, static: StaticGeometry, cameras: int, hold: float, weak_window: float
    ) -> None:
        if cameras > 8:
            raise ValueError(f"{cameras} depth cameras; the map can tell 8 apart")
        self.grid = grid = static.grid
        self._hold = hold
        self._window = weak_window
        size = int(np.prod(grid.shape))
        self._origin = np.asarray(grid.origin, float)
        self._shape = np.asarray(grid.shape, np.int64)
        self._declare(static)
        self.free = np.zeros((max(cameras, 1), size), np.uint8)
        self.occupied = np.zeros(size, np.uint8)
        self._seen_by = np.zeros(size, np.uint8)
        self._last = np.full(size, -np.inf)
        self._weak = np.full(size, -np.inf)
        self._looks = np.zeros(size, np.uint8)
        self._listed = np.empty(size, np.int32)
        self._count = 0

    def take(
        self,
        camera: int,
        stamp: float,
        hits: Ints32,
        strong: Bytes,
        body: Bytes,
        sight: Sight | None = None,
    ) -> None:
        """Take in one frame's evidence; its free voxels already lie in ``free[camera]``.

        Args:
            camera: index of the camera.
            stamp: exposure [s].
            hits: (m,) int32 flat indices of the voxels hit.
            strong: (m,) uint8, 1 where the sighting is strong.
            body: flat uint8, what the arm's own body fills of each voxel: nothing, MIDDLE or WHOLE.
            sight: the frame, to see which occupied voxels it looked at in vain.
        """
        bit = 1 << camera
        self._count = add_hits(
            hits,
            strong,
            len(hits),
            stamp,
            bit,
            self._window,
            self.occupied,
            self._seen_by,
            self._last,
            self._weak,
            self._looks,
            self._listed,
            self._count,
        )
        if sight is not None:
            add_looks(
                *sight,
                self._inside,
                self.declared.table,
                self._origin,
                self.grid.voxel,
                self._shape,
                body,
                stamp,
                self._last,
                self._looks,
                self._listed,
                self._count,
            )
        self._count = clear_seen_through(
            self.free[camera],
            body,
            stamp,
            bit,
            self._hold,
            self.occupied,
            self._seen_by,
            self._last,
            self._looks,
            LOOKS,
            FORGET,
            self._listed,
            self._count,
        )

    def _declare(self, static: StaticGeometry) -> None:
        self.declared = static
        self._filled = np.ascontiguousarray(static.filled).reshape(-1)
        nearest = static.nearest.reshape(-1)
        self._inside: Bytes = np.where(static.bound.reshape(-1) < 0, nearest, np.uint8(0))

    def redeclare(self, static: StaticGeometry, filled: Mask) -> None:
        """Other solids are declared: what was seen where one is now was that solid.

        Unless it was seen deep inside of it: that is looked at anew.

        Args:
            static: declared solids.
            filled: (nx, ny, nz) bool, voxels that they fill and that were not filled before.
        """
        self._declare(static)
        listed = self.dynamic.copy()
        gone = filled.reshape(-1)[listed]
        at = listed[gone]
        gone[gone] = self.inside_of(at)[1] <= DEEP
        lost, kept = listed[gone], listed[~gone]
        for array in (self.occupied, self._seen_by, self._looks):
            array[lost] = 0
        self._weak[filled.reshape(-1)] = -np.inf
        self._listed[: len(kept)] = kept
        self._count = len(kept)

    def turn_back(self, seconds: float) -> None:
        """The clock was turned back by a time [s]: ages stay, and weak sightings are forgotten."""
        self._last -= seconds
        self._weak.fill(-np.inf)

    def inside_of(self, index: Ints32) -> tuple[Bytes, Floats]:
        """Which declared solids voxels' centres are in, and how much deeper than these are coarse.

        Args:
            index: (m,) flat indices of the voxels.

        Returns:
            (m,) uint8 1 + index of the solid, 0 where there is none, and (m,) [m], -inf there.
        """
        solid, depth = self._inside[index], np.full(len(index), -np.inf)
        for s in np.unique(solid[solid > 0]):
            at, declared = solid == s, self.declared.solids[s - 1]
            depth[at] = -declared.distance(self.center(index[at])) - declared.coarse
        return solid, depth

    def center(self, index: Ints32) -> Points:
        """(m, 3) centres in ``base`` [m] of voxels by (m,) flat indices."""
        return self.grid.center(np.stack(np.unravel_index(index, self.grid.shape), axis=-1))

    @property
    def half_diagonal(self) -> float:
        """Of a voxel [m]."""
        return float(0.5 * np.sqrt(3.0) * self.grid.voxel)

    @property
    def dynamic(self) -> Ints32:
        """(m,) int32 flat indices of the voxels occupied by something undeclared."""
        return self._listed[: self._count]

    def clusters(self, neighbors: int) -> Ints32:
        """Those of :attr:`dynamic` with at least so many of them among their 26 neighbours.

        A single voxel is a stray measurement far more often than a part of a person.
        """
        kept = np.empty(self._count, np.int32)
        found = keep_clusters(
            self._listed, self._count, self.occupied, self._shape, neighbors, kept
        )
        return kept[:found]

    def state(self, alive: Bytes) -> Bytes:
        """(nx, ny, nz) uint8 state, a new array; ``alive`` (cameras,) says whose word counts."""
        out = np.empty(len(self.occupied), np.uint8)
        compose_state(self.free, alive, self.occupied, self._filled, out)
        return out.reshape(self.grid.shape)

    def last_occupied(self) -> Floats32:
        """(nx, ny, nz) float32 [s] when each voxel was last seen occupied, a new array."""
        return self._last.astype(np.float32).reshape(self.grid.shape)
