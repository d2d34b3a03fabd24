"""Where someone unseen could be: a set that grows through unseen space and shrinks by sight.

A person comes from outside the observed space or is part of something seen. Nobody appears in a
pocket of unseen space that seen free space and declared solids enclose, such as the arm's shadow;
nor in one too small for a hand. So the set of possible places begins at the outside and at
everything seen that is not declared, spreads from there through space that is not seen free, at
most as fast as a person moves, and loses whatever is seen free. A person hangs together: what is
cut off from the outside and from everything seen hides nobody, though it once did not seem so
(before all cameras had looked, say).

Above the mapped box people are only as far as an arm is long from where they reach out of it
(:mod:`.overhead`): :meth:`UnseenPeople.reaching` says where that could be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from armsight.arrays import Bytes, Ints32, Mask, Words
from armsight.mapping.kernels.flood import (
    add_voxels,
    clear_rim,
    copy_shell,
    count_voxels,
    fill_rim,
    frontier,
    grow,
    intersect,
    open_by_cube,
    pack,
    pack_room,
    remove_voxels,
    replace_outside,
    spread,
    unpack,
)
from armsight.mapping.snapshot import ENCLOSED, UNKNOWN, VoxelGrid
from armsight.mapping.tracked import TOUCHES, TrackedThing


class UnseenSets(NamedTuple):
    """Sets packed to bits, not to be written to.

    Attributes:
        possible: where somebody could be unseen.
        room: what is not seen free and has room for a hand; nobody is in a thinner place.
        rim: of both.
    """

    possible: Words
    room: Words
    rim: int


class Lid(NamedTuple):
    """What is above a grid, for :meth:`UnseenPeople.reaching`.

    Attributes:
        axis: that points up or down.
        steps: voxels that an arm is long.
        below: set of all but what is above and below the grid.
        above: set of what is right above it.
    """

    axis: int
    steps: int
    below: Words
    above: Words


class Tracked(NamedTuple):
    """What a task tracks in one update.

    Attributes:
        thing: where.
        occupied: flat uint8, 1 where something undeclared is seen, things told from people as well.
    """

    thing: TrackedThing
    occupied: Bytes


class UnseenPeople:
    """The set of voxels that could hide someone.

    Args:
        grid: the grid.
        static: (nx, ny, nz) uint8 voxels filled by declared solids.
        speed: how fast someone may move [m/s].
        hand: edge of the smallest cube that can hold a part of a person [m].
        around: the set of a coarser grid that encloses this one: people come from there. Without
            it, anybody may be anywhere outside.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        static: Bytes,
        speed: float,
        hand: float,
        around: UnseenPeople | None = None,
    ) -> None:
        self._grid = grid
        self._static = np.ascontiguousarray(static).reshape(grid.shape)
        self._speed = speed
        self._edge = max(int(np.ceil(hand / grid.voxel - 1e-6)), 1)
        self._rim = self._edge
        self._around = around
        nx, ny, nz = grid.shape
        self._depth = nz + 2 * self._rim
        shape = (nx + 2 * self._rim, ny + 2 * self._rim, (self._depth + 63) // 64)
        self._possible: Words = np.zeros(shape, np.uint64)
        self._room: Words = np.zeros(shape, np.uint64)
        self._a: Words = np.zeros(shape, np.uint64)
        self._b: Words = np.zeros(shape, np.uint64)
        self._solid: Words = np.zeros(shape, np.uint64)
        pack(self._static, self._rim, self._solid)
        self._outside: Words = np.zeros(shape, np.uint64)
        if around is None:
            fill_rim(self._rim, self._depth, self._outside)
        else:
            self._shell, self._cells = self._shell_in(around)
        self._nobody = np.zeros(grid.shape, np.uint8)
        self._indices = np.empty(nx * ny * nz, np.int32)
        self._faces = np.empty(nx * ny * nz, np.uint8)
        self._owed = 0.0
        self._begun = False

    def _shell_in(self, around: UnseenPeople) -> tuple[Ints32, Ints32]:
        """The rim's innermost layer: its places in the bit array, its cells in the coarser grid."""
        nx, ny, nz = self._grid.shape
        index = np.stack(
            np.meshgrid(*(np.arange(-1, n + 1) for n in (nx, ny, nz)), indexing="ij"), axis=-1
        ).reshape(-1, 3)
        index = index[((index < 0) | (index >= [nx, ny, nz])).any(axis=1)]
        cells = around._grid.index(self._grid.center(index))
        assert (cells >= -1).all(), "the grid around does not enclose this one"
        assert (cells <= np.asarray(around._grid.shape)).all()
        return (index + self._rim).astype(np.int32), cells.astype(np.int32)

    def update(
        self,
        state: Bytes,
        dynamic: Ints32,
        body: Bytes | None,
        elapsed: float,
        tracked: Tracked | None = None,
    ) -> tuple[Ints32, Bytes]:
        """The outermost voxels that could hide someone, and which of their faces are open.

        Args:
            state: (nx, ny, nz) state of the voxels.
            dynamic: flat indices of voxels occupied by something undeclared.
            body: (nx, ny, nz) uint8, 1 where the arm itself is; None if it does not matter.
            elapsed: time since the last update [s].
            tracked: what a task tracks, no source of people while nobody is around it; or None.

        Returns:
            (m,) flat indices and (m,) uint8 faces (bits -x +x -y +y -z +z); valid until the next
            update.
        """
        _, ny, nz = self._grid.shape
        own = self._nobody if body is None else body
        pack_room(state, self._static, own, self._rim, self._room)
        open_by_cube(self._room, self._edge, self._depth)
        intersect(self._possible, self._room)
        if self._around is not None:
            clear_rim(self._rim, self._depth, self._possible)
            clear_rim(self._rim, self._depth, self._room)
            self._look_outside(self._around)
            self._room |= self._outside
        others = dynamic
        if not self._begun:
            tracked = None  # what could be behind it has to be known first
        if tracked is not None:
            nobody = tracked.thing.nobody(tracked.occupied, self._room, self._rim)
            remove_voxels(nobody, len(nobody), ny, nz, self._rim, self._possible)
            others = dynamic[~tracked.thing.holds(dynamic)]
        self._add_sources(self._possible, others)
        for _ in range(self._steps(elapsed)):
            if not grow(self._possible, self._room, self._a, self._b):
                break
        if tracked is not None:  # what hangs together with it stays possible, if it was
            add_voxels(dynamic, len(dynamic), ny, nz, self._rim, self._possible)
        self._a.fill(0)
        self._add_sources(self._a, dynamic)
        spread(self._a, self._possible)
        self._possible, self._a = self._a, self._possible
        if tracked is not None:
            self._tell_apart(tracked.thing, dynamic)
        count = frontier(self._possible, self._solid, self._rim, ny, nz, self._indices, self._faces)
        return self._indices[:count], self._faces[:count]

    def _tell_apart(self, thing: TrackedThing, dynamic: Ints32) -> None:
        """What is tracked is in the set only if somebody, seen or unseen, could be around it.

        Nobody unseen is missed by taking it out first: who is in it was in the set before, since
        they were elsewhere then, and the set has grown from there.
        """
        _, ny, nz = self._grid.shape
        rim, bits = self._rim, self._possible
        own = dynamic[thing.holds(dynamic)]
        remove_voxels(own, len(own), ny, nz, rim, bits)
        if count_voxels(thing.around, len(thing.around), ny, nz, rim, bits) >= TOUCHES:
            add_voxels(own, len(own), ny, nz, rim, bits)

    def reaching(self, dynamic: Ints32, lid: Lid) -> Mask:
        """Where an arm could be above the grid, as of the last update.

        An arm belongs to somebody who is seen; from there it reaches, unseen as well, through what
        could hide them, and over the top.

        Args:
            dynamic: as it was given to that update.
            lid: what is above.

        Returns:
            (a, b) over the two axes beside ``lid.axis``.
        """
        _, ny, nz = self._grid.shape
        if len(dynamic) == 0 or lid.steps == 0:
            return np.zeros([n for k, n in enumerate(self._grid.shape) if k != lid.axis], bool)
        rim, within, arms = self._rim, self._a, self._b
        np.bitwise_and(self._possible, lid.below, out=within)
        arms.fill(0)
        add_voxels(dynamic, len(dynamic), ny, nz, rim, arms)
        arms &= within
        bodies = self._plane(arms, lid.axis)
        within |= lid.above
        a, b = np.empty_like(arms), np.empty_like(arms)
        for _ in range(lid.steps):
            if not grow(arms, within, a, b):
                break
        arms &= lid.above
        there = self._plane(arms, lid.axis)
        if there.any():  # steps to all neighbours go farther in between than along the axes
            there &= distance_transform_edt(~bodies) <= lid.steps
        return np.asarray(there[rim:-rim, rim:-rim])

    def _plane(self, bits: Words, axis: int) -> Mask:
        """(a + 2 rim, b + 2 rim) whether a set has anything along an axis."""
        there = np.bitwise_or.reduce(bits, axis=axis)
        if axis < 2:
            there = np.unpackbits(there.view(np.uint8), axis=1, bitorder="little")
            there = there[:, : self._depth]
        return np.asarray(there != 0)

    def lid(self, axis: int, upwards: bool, steps: int) -> Lid:
        """What is above the grid, for :meth:`reaching`.

        Args:
            axis: that points up or down.
            upwards: whether up.
            steps: voxels that an arm is long.
        """
        shape, rim = self._possible.shape, self._rim
        below, above = np.zeros((2, *shape[:2], 64 * shape[2]), bool)
        last = self._grid.shape[axis] + rim
        first = (slice(None),) * axis
        below[(*first, slice(rim, last))] = True
        there = [slice(rim, n + rim) for n in self._grid.shape]
        there[axis] = slice(last, last + 1) if upwards else slice(rim - 1, rim)
        above[tuple(there)] = True
        return Lid(axis, steps, _packed(below), _packed(above))

    def _look_outside(self, around: UnseenPeople) -> None:
        """Note from which places people come: what the coarser set says of the rim."""
        self._outside.fill(0)
        copy_shell(around._possible, around._rim, self._cells, self._shell, self._outside)

    def _add_sources(self, bits: Words, dynamic: Ints32) -> None:
        """Add the outside and everything seen that may be a person."""
        _, ny, nz = self._grid.shape
        bits |= self._outside
        add_voxels(dynamic, len(dynamic), ny, nz, self._rim, bits)

    def _steps(self, elapsed: float) -> int:
        """Voxels by which the set may grow now: as far as someone can go, all the way at first."""
        if not self._begun:
            self._begun = True
            return sum(self._grid.shape)
        self._owed += self._speed * max(elapsed, 0.0) / self._grid.voxel
        steps = int(self._owed)
        self._owed -= steps
        return steps

    @property
    def sets(self) -> UnseenSets:
        """As of the last update."""
        return UnseenSets(self._possible, self._room, self._rim)

    def nobody(self) -> None:
        """Somebody said that nobody is here: people come from the outside only."""
        self._possible.fill(0)

    def redeclare(self, static: Bytes, left: Mask) -> None:
        """Other solids are declared: who was in one that is gone could be there.

        Args:
            static: (nx, ny, nz) uint8 voxels filled by declared solids.
            left: (nx, ny, nz) bool, those that were filled before and are no longer.
        """
        self._static = np.ascontiguousarray(static).reshape(self._grid.shape)
        pack(self._static, self._rim, self._solid)
        flat = np.flatnonzero(left).astype(np.int32)
        _, ny, nz = self._grid.shape
        add_voxels(flat, len(flat), ny, nz, self._rim, self._possible)

    def mark_enclosed(self, state: Bytes) -> None:
        """Turn UNKNOWN to ENCLOSED, in place, where nobody can be."""
        replace_outside(self._possible, self._rim, UNKNOWN, ENCLOSED, state)

    def mask(self) -> Bytes:
        """(nx, ny, nz) uint8, 1 where someone could be, seen or unseen."""
        out = np.zeros(self._grid.shape, np.uint8)
        unpack(self._possible, self._rim, out)
        return out


def _packed(mask: Mask) -> Words:
    """(x, y, z) truth values to bits, 64 to a word along z."""
    eights = np.packbits(mask, axis=2, bitorder="little")
    return np.ascontiguousarray(eights).view(np.uint64)
