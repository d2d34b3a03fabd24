"""Things told from people by their history, never by their looks.

Whatever is occupied and not declared counts as a person unless it is known to be a thing:

* *It was there when nobody was.* Somebody said that the cell is empty, nothing had moved for a
  second, and since then the piece has neither moved nor been touched.
* *It could not hide anybody.* What becomes visible where, a moment before, nobody could be.
* *It was left behind.* A person (a piece too large to be a thing, or one that goes on out of the
  map) held it; now it and all that hangs together with it, hollows and shadows included as far as
  a hand fits into them, is smaller than any person; and it has rested since.

Whatever somebody knows to move by itself (another arm) is none, however long it rests.

A thing ends, and counts as a person again with all that could be behind it, as soon as something
that may be a person, seen or unseen, is within two voxels of it, or when it moves by more than one
voxel. See ``docs/guard.md`` for what follows from that, and what it assumes.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from armsight.arrays import Bytes, Floats, Ints32, Mask, Points, Shorts
from armsight.mapping.hazards import UnseenSets
from armsight.mapping.kernels.pieces import (
    belongs,
    enclosed_piece,
    forget_free,
    label_pieces,
    newcomers,
    note_onsets,
    small_pieces,
    touched,
    touched_unseen,
)
from armsight.mapping.snapshot import ENCLOSED, FREE, VoxelGrid
from armsight.mapping.tracked import SMALLEST_PERSON

MOST_THINGS = 4096
GRACE = 0.3
"""Noise may lose a voxel for so long [s] without it being new when it comes back."""
GONE = 2.0
"""A thing's voxel that has been seen free for so long [s] is no part of it any more."""
SETTLE = 1.0
"""After the cell was said to be empty, noise still adds voxels beside a thing for so long [s]."""
STILL = 1.0
"""What was left behind must have been at rest for so long [s]; so must an empty cell."""
PATIENCE = 5.0
"""The word that the cell is empty is refused when something goes on moving for so long [s]."""
TOUCH = 2
"""Voxels within which something that may be a person touches a thing."""
NEWCOMERS = 5
"""As many new voxels in a cluster are movement, fewer are noise."""
CAME = 0.02
"""So much surface [m^2] that came in together is somebody, or a part of somebody, ..."""
CAME_VOXELS = 10
"""... but no fewer voxels: coarse ones beside a surface come and go; ..."""
CAME_SHARE = 0.5
"""... and it is this share of all that is there: noise makes parts of a surface come anew."""
LATELY = 1.0
"""What was seen free in the last one or two of these [s], and is occupied, came there."""
NEAR = 0.15
"""Nothing newly visible is a thing this close to somebody [m]: as far as a hand goes in a frame."""
LATE = 0.15
"""Nor is it one if nobody looked for so long [s]: who came meanwhile may be far into it."""
LIVELY = 20.0
"""Of what may move by itself somebody's word holds for so long [s]."""
LIVELY_VOXELS = 4
"""As many of its voxels make a thing that: fewer may be a picture's border."""
TOUCHES = 3
"""As many voxels must do so, in the fine layer: noise beside a surface does not end a thing."""


class Things:
    """The things of one grid.

    Args:
        grid: where the voxels lie.
        touches: as many voxels of somebody near a thing end it.
    """

    def __init__(self, grid: VoxelGrid, touches: int = TOUCHES) -> None:
        size = int(np.prod(grid.shape))
        self._grid = grid
        self._shape = np.asarray(grid.shape, np.int64)
        self._seen: Floats = np.full(size, -np.inf)
        self._onset: Floats = np.zeros(size)  # of what is seen; and so below
        self._held: Floats = np.zeros(size)
        self._came: Mask = np.zeros(size, bool)  # into space that had been seen free
        self._free: Mask = np.zeros((2, size), bool)  # seen so lately, and before that
        self._turned = -np.inf
        self._core: Shorts = np.zeros(size, np.uint16)
        self._active: Bytes = np.zeros(MOST_THINGS, np.uint8)
        self._next = 1
        self._cores: Ints32 = np.zeros(0, np.int32)
        self._mark: Ints32 = np.zeros(size, np.int32)
        self._round = 2
        self._limit = max(int(SMALLEST_PERSON / grid.voxel**3), 1)
        self._queue: Ints32 = np.zeros(size, np.int32)
        self._fresh: Ints32 = np.zeros(size, np.int32)
        self._thing: Shorts = np.zeros(size, np.uint16)
        self._touches: Ints32 = np.zeros(MOST_THINGS, np.int32)
        self._least = touches
        self._trait: Bytes = np.zeros(size, np.uint8)
        self._before: Bytes = np.zeros(size, np.uint8)
        self._lively: list[tuple[float, Ints32]] = []
        self._settling = self._now = self._kept = 0.0
        self.telling = False

    def moving(self, clusters: Ints32, occupied: Bytes, now: float) -> int:
        """Flat index of a voxel where something came within the last second, or -1."""
        # What is seen for the first time, or again, has no onset yet: it has just come.
        known = now - self._seen[clusters] <= GRACE
        old = known & (self._onset[clusters] <= now - STILL)
        count = self._strangers(clusters, occupied, old)
        return int(self._fresh[count // 2]) if count >= NEWCOMERS else -1

    def came_in(self, clusters: Ints32, occupied: Bytes, unseen: UnseenSets) -> int:
        """Flat index of a voxel of somebody who came in while the map looked, or -1.

        That is what came into space that was seen free, is not known to be a thing, and is too
        large to be one, or hangs together with what is: keeping still does not make it one.
        """
        people = clusters[self._people(clusters)]
        _, large = self._sort(people, occupied, unseen)
        came = people[self._came[people] & (self._mark[people] == large)]
        there = np.zeros(self._grid.shape, bool)
        there.reshape(-1)[came] = True
        of = label(there, np.ones((3, 3, 3)))[0].reshape(-1)[came]
        most = int(np.argmax(np.bincount(of, minlength=1)))
        mine = came[of == most]
        if len(mine) < max(CAME / self._grid.voxel**2, CAME_VOXELS):
            return -1
        index = np.stack(np.unravel_index(mine, self._grid.shape), axis=1)
        all_of_it = np.stack(np.unravel_index(people, self._grid.shape), axis=1)
        around = ((all_of_it >= index.min(axis=0)) & (all_of_it <= index.max(axis=0))).all(axis=1)
        return -1 if len(mine) < CAME_SHARE * around.sum() else int(mine[len(mine) // 2])

    def begin(self, listed: Ints32, occupied: Bytes, now: float) -> None:
        """Nobody is in the cell: whatever is there now is a thing."""
        self._core.fill(0)
        self._active.fill(0)
        self._next = 1
        self._cores = listed.copy()
        self._number(listed, occupied)
        self._settling = now + SETTLE
        self.telling = True

    def animate(self, points: Points, now: float) -> None:
        """What is at (k, 3) points in ``base`` [m] may move by itself, as of ``now`` [s]."""
        index = self._grid.index(points)
        inside = ((index >= 0) & (index < self._shape)).all(axis=1)
        flat = np.ravel_multi_index(index[inside].T, self._grid.shape)
        self._lively.append((now + LIVELY, np.unique(flat).astype(np.int32)))

    def end(self) -> None:
        """Nothing is a thing any more (the clock was turned back, say)."""
        self._lively.clear()
        self._core.fill(0)
        self._active.fill(0)
        self._cores = np.zeros(0, np.int32)
        self._seen.fill(-np.inf)
        self._before = np.zeros_like(self._before)
        self._free.fill(False)
        self._turned = -np.inf
        self.telling = False

    def update(
        self,
        state: Bytes,
        listed: Ints32,
        clusters: Ints32,
        occupied: Bytes,
        unseen: UnseenSets,
        now: float,
    ) -> Mask:
        """Which of ``clusters`` may be people.

        Args:
            state: (nx, ny, nz) state of the voxels.
            listed: flat indices of the voxels occupied by something undeclared.
            clusters: those of them that are no stray measurements.
            occupied: flat uint8, 1 where ``listed``.
            unseen: where somebody could be unseen, as of the last update.
            now: time [s].

        Returns:
            (m,) bool, true for those of ``clusters`` that count as people.
        """
        self._now = now
        count = len(listed)
        news = note_onsets(
            listed,
            count,
            now,
            GRACE,
            self._seen,
            self._onset,
            self._held,
            self._before,
            self._fresh,
        )
        fresh = self._fresh[:news]
        self._came[fresh] = self._free[:, fresh].any(axis=0)
        if not self.telling:
            return np.ones(len(clusters), bool)
        flat = state.reshape(-1)
        left = forget_free(self._cores, len(self._cores), flat, now, GONE, self._seen, self._core)
        self._cores = self._cores[:left]
        people = self._people(clusters)
        if self._reveal(fresh, clusters[people]):
            people = self._people(clusters)
        thing = self._thing[:count]
        self._tell(listed, thing)
        if now < self._settling:
            self._settle(listed, thing)
        if touched_unseen(
            listed, thing, count, unseen.possible, unseen.rim, self._active, self._shape
        ):
            self._forget_ended()
            people = self._people(clusters)
        if self._left_behind(clusters[people], occupied, unseen):
            people = self._people(clusters)
        if self._stir():
            people = self._people(clusters)
        while self._touch(clusters[people]):  # a thing that ended may touch another
            self._forget_ended()
            people = self._people(clusters)
        return people

    def solid(self, listed: Ints32) -> Ints32:
        """Those of the last update's ``listed`` that belong to things."""
        if not self.telling:
            return listed[:0]
        return listed[self._thing_of(listed) != 0]

    def keep(self, state: Bytes) -> None:
        """Remember where nobody could be: ``state`` with its enclosed voxels marked."""
        self._before, self._kept = state.reshape(-1), self._now
        if self._now - self._turned > LATELY:
            self._free[1], self._turned = self._free[0], self._now
            self._free[0].fill(False)
        self._free[0] |= self._before == FREE

    # -- inside ---------------------------------------------------------------------------------

    def _tell(self, voxels: Ints32, out: Shorts) -> None:
        """To which thing each voxel belongs; 0 for none."""
        belongs(
            voxels,
            len(voxels),
            self._now,
            GRACE,
            self._seen,
            self._core,
            self._active,
            self._shape,
            out,
        )

    def _thing_of(self, voxels: Ints32) -> Shorts:
        out = np.zeros(len(voxels), np.uint16)
        self._tell(voxels, out)
        return out

    def _people(self, clusters: Ints32) -> Mask:
        return np.asarray(self._thing_of(clusters) == 0)

    def _number(self, voxels: Ints32, occupied: Bytes) -> None:
        """Make things of the pieces of voxels that belong to none yet."""
        room = MOST_THINGS - 1
        if self._next >= room:
            return  # they stay people: safe
        ended = label_pieces(
            voxels, len(voxels), occupied, self._shape, self._core, self._next, self._queue
        )
        if ended > room:  # thousands of pieces at once are noise, not things
            self._core[voxels[self._core[voxels] >= self._next]] = 0
            return
        self._active[self._next : ended] = 1
        self._next = ended

    def _settle(self, listed: Ints32, thing: Shorts) -> None:
        """The skin of things becomes a part of them."""
        skin = (thing != 0) & (self._core[listed] == 0)
        self._core[listed[skin]] = thing[skin]
        self._cores = np.concatenate([self._cores, listed[skin]])

    def _reveal(self, fresh: Ints32, people: Ints32) -> bool:
        """What comes to light where nobody could be is a thing. True if there is some."""
        if self._now - self._kept > LATE:
            return False
        new = fresh[(self._before[fresh] == ENCLOSED) & (self._core[fresh] == 0)]
        if not len(new):
            return False
        others = np.setdiff1d(people, new)
        if len(others):
            a, b = self._centers(new), self._centers(others)
            near = np.array([np.min(np.abs(b - p).max(axis=1)) <= NEAR for p in a], bool)
            new = new[~near]
        alone = np.zeros(len(self._core), np.uint8)
        alone[new] = 1
        self._number(new, alone)
        self._cores = np.concatenate([self._cores, new])
        return len(new) > 0

    def _touch(self, people: Ints32) -> int:
        """End what somebody touches; how many things."""
        return touched(
            people,
            len(people),
            TOUCH,
            self._least,
            self._core,
            self._active,
            self._touches,
            self._shape,
        )

    def _stir(self) -> bool:
        """End what may move by itself. True if there was a thing that may."""
        self._lively = [word for word in self._lively if word[0] > self._now]
        if not self._lively:
            return False
        of = self._thing_of(np.unique(np.concatenate([voxels for _, voxels in self._lively])))
        counts = np.bincount(of[of != 0], minlength=1)
        moving = np.flatnonzero(counts >= LIVELY_VOXELS)
        if not len(moving):
            return False
        self._active[moving] = 0
        self._forget_ended()
        return True

    def _forget_ended(self) -> None:
        """What has just been a thing is in somebody's hands, and has to come to rest anew."""
        core = self._core[self._cores]
        ended = (core != 0) & (self._active[core] == 0)
        voxels = self._cores[ended]
        self._core[voxels] = 0
        self._onset[voxels] = self._now
        self._held[voxels] = self._now
        self._cores = self._cores[~ended]

    def _left_behind(self, people: Ints32, occupied: Bytes, unseen: UnseenSets) -> bool:
        """Make things of what people left; note what they hold. True if there is a new one."""
        starts, large = self._sort(people, occupied, unseen)
        again = self._round + 2
        space = (occupied, unseen.room, unseen.rim, self._shape, self._limit, self._mark)
        found = False
        for v in starts:
            size = enclosed_piece(int(v), *space, again, large, self._queue)
            piece = self._queue[:size]
            matter = piece[occupied[piece] != 0].copy()
            if self._at_rest(matter, occupied) and self._was_left(matter, occupied):
                self._number_piece(matter)
                found = True
        return found

    def _sort(self, people: Ints32, occupied: Bytes, unseen: UnseenSets) -> tuple[Ints32, int]:
        """One voxel of each small piece of ``people``, and the mark of what belongs to large ones.

        What belongs to a large one is held now.
        """
        self._round += 3
        if self._round > 2**30:
            self._mark.fill(0)
            self._round = 3
        number, large = self._round, self._round + 1
        starts = np.empty(len(people), np.int32)
        space = (occupied, unseen.room, unseen.rim, self._shape, self._limit, self._mark)
        count = small_pieces(
            people, len(people), *space, number, large, self._now, self._held, starts, self._queue
        )
        return starts[:count], large

    def _at_rest(self, matter: Ints32, occupied: Bytes) -> bool:
        old = self._onset[matter] <= self._now - STILL
        return self._strangers(matter, occupied, old) < NEWCOMERS

    def _was_left(self, matter: Ints32, occupied: Bytes) -> bool:
        """Whether somebody held all of it (or it came to light with what was held), and no more."""
        held = self._held[matter]
        if (held > self._now - STILL).any():
            return False
        return self._strangers(matter, occupied, np.isfinite(held)) < NEWCOMERS

    def _strangers(self, matter: Ints32, occupied: Bytes, trait: Mask) -> int:
        """How many voxels of a piece are without a trait, and all their neighbours, too."""
        self._trait[matter] = trait
        count = newcomers(matter, len(matter), occupied, self._trait, self._shape, self._fresh)
        self._trait[matter] = 0
        return int(count)

    def _number_piece(self, matter: Ints32) -> None:
        if self._next >= MOST_THINGS - 1:
            return
        self._core[matter] = self._next
        self._active[self._next] = 1
        self._cores = np.concatenate([self._cores, matter])
        self._next += 1

    def _centers(self, flat: Ints32) -> Floats:
        index = np.stack(np.unravel_index(flat, self._grid.shape), axis=1)
        return np.asarray(self._grid.center(index), float)
