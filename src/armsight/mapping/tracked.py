"""What a task tracks in order to touch it is no place from which somebody could come.

Whatever is seen and not declared may be a person, so the places that could hide somebody unseen
begin at it. A ball in the air would make its own shadow such a place, and with it the arm's shadow,
as soon as the two join: nothing could ever be touched that moves. A task that asks for a permit
says where the thing is, and the map holds what is in that region for nobody as long as

* two voxels around it nothing that may be a person is, seen or unseen (a person hangs together and
  is larger than the region, so who is in it is around it as well); or
* all that hangs together with it, seen or unseen as far as a hand fits in, is smaller than any
  person: then nobody is in any of that, shadow and all, and it is no possible place any more.

It stays a hazard; only a permit (:mod:`armsight.motion.permitted`) changes that. Where somebody is
beside it, it is a source like everything seen. ``docs/guard.md`` has the proof.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from armsight.arrays import Bytes, Floats, Ints32, Mask, Points, Vector3, Words
from armsight.mapping.kernels.pieces import enclosed_piece
from armsight.mapping.snapshot import VoxelGrid

SMALLEST_PERSON = 0.04
"""No person fits wholly into less space than this [m^3], not seen free by any camera.

An adult of 45 kg has 0.045 m^3, and unseen voxels along the outline come on top.
"""
SEEN_WITHIN = 0.02
"""Depth noise and calibration put a surface this far from where it is [m], beyond the voxel: three
sigma of a Kinect v2 at 2 m, and what alignment leaves."""
LINGERS = 0.1
"""What has moved on stays in the map for so long [s]."""
SURE = 2.0
"""Standard deviations of the region's place that count as possible."""
SHELL = 2
"""Voxels around the region in which nobody may be: a person hangs together, and is larger."""
TOUCHES = 3
"""As many voxels there are somebody; fewer are noise (as for things)."""
KEPT = 0.3
"""A region that nobody speaks of any more is followed for so long [s]."""
LARGEST = 1.0
"""No region is larger with all around it [m]: the map does not follow it."""


class TrackedRegion(Protocol):
    """A region of space that follows what was seen; :class:`armsight.motion.regions.Region`."""

    @property
    def extent(self) -> float:
        """Greatest distance between two of its points [m]."""
        ...

    @property
    def speed(self) -> float:
        """Of its centre [m/s]."""
        ...

    def center(self, when: float) -> Vector3:
        """(3,) where its centre is expected at a time [s], in ``base`` [m]."""
        ...

    def deviation(self, when: float) -> float:
        """Standard deviation [m] of the centre at a time [s]."""
        ...

    def distance(self, points: Points, when: float) -> Floats:
        """(n,) signed distance [m] of (n, 3) points in ``base``; negative inside."""
        ...


def growth(region: TrackedRegion, stamp: float, hazard_radius: float) -> float:
    """How far from a region [m] a map of a time [s] may have what is in it, at a voxel's centre.

    Args:
        region: the region.
        stamp: of the map.
        hazard_radius: half diagonal of a voxel [m].
    """
    unsure = SURE * region.deviation(stamp)
    return hazard_radius + SEEN_WITHIN + unsure + LINGERS * region.speed


class TrackedThing:
    """What a task tracks, on one grid.

    Attributes:
        inside, around: (m,) int32 flat indices of the voxels in the region and in its shell.
    """

    def __init__(self, grid: VoxelGrid) -> None:
        self.inside: Ints32 = np.zeros(0, np.int32)
        self.around: Ints32 = np.zeros(0, np.int32)
        self._grid = grid
        self._shape = np.asarray(grid.shape, np.int64)
        self._region: TrackedRegion | None = None
        self._told = -np.inf
        self._limit = max(int(SMALLEST_PERSON / grid.voxel**3), 1)
        self._mark: Ints32 = np.zeros(int(np.prod(grid.shape)), np.int32)
        self._queue: Ints32 = np.zeros(self._limit + 32, np.int32)
        self._round = 0

    def follow(self, region: TrackedRegion | None, stamp: float, now: float) -> bool:
        """Look where the region is in a map of a time [s]; whether there is one.

        Args:
            region: the newest that was asked for, or None.
            stamp: of the map that is being made [s].
            now: time [s].
        """
        if region is not None:
            self._region, self._told = region, now
        elif not 0.0 <= now - self._told <= KEPT:
            self._region = None
        region = self._region
        if region is None or not np.isfinite(stamp):
            return False
        grid = self._grid
        grown = growth(region, stamp, 0.5 * np.sqrt(3.0) * grid.voxel)
        shell = SHELL * grid.voxel
        reach = 0.5 * region.extent + grown + shell
        if not reach <= 0.5 * LARGEST:
            return False
        center = region.center(stamp)
        if not np.isfinite(center).all():
            return False
        low, high = grid.index(np.stack([center - reach, center + reach]))
        if (low < 1).any() or (high >= self._shape - 1).any():
            return False  # at the border of the map people come and go
        axes = [np.arange(a, b + 1) for a, b in zip(low, high)]
        index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        distance = region.distance(grid.center(index), stamp)
        flat = np.ravel_multi_index(tuple(index.T), grid.shape).astype(np.int32)
        self.inside = flat[distance <= grown]
        self.around = flat[(distance > grown) & (distance <= grown + shell)]
        return True

    def holds(self, voxels: Ints32) -> Mask:
        """(m,) bool, which of some voxels (flat indices) are in the region."""
        return np.isin(voxels, self.inside)

    def nobody(self, occupied: Bytes, room: Words, rim: int) -> Ints32:
        """Flat indices of what hangs together with the thing and is too small for a person.

        Args:
            occupied: flat uint8, 1 where something undeclared is seen.
            room: the places in which a hand fits and that are not seen free, as bits.
            rim: of that set.
        """
        if self._round > 2**30:
            self._mark.fill(0)
            self._round = 0
        self._round += 2
        small, large = self._round, self._round + 1
        found: list[Ints32] = []
        for v in self.inside[occupied[self.inside] != 0]:
            if self._mark[v] in (small, large):
                continue
            size = enclosed_piece(
                int(v), occupied, room, rim, self._shape, self._limit, self._mark, small, large,
                self._queue,
            )  # fmt: skip
            found.append(self._queue[:size].copy())
        return np.concatenate(found) if found else np.zeros(0, np.int32)
