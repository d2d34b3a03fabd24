"""Compiled loops that tell things from people: onsets of voxels, touches, enclosed pieces.

Voxels are flat indices of an (nx, ny, nz) grid; ``core`` holds for each the number of the thing
that it belongs to (0: none), ``active`` by number whether that thing still is one.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Ints, Ints32, Shorts, Words

FREE = 1
MOST_PIECES = 65535
"""A number of a thing goes no higher."""
LONG_AGO = -1e9
"""When something was held that came to light afterwards [s]."""
ONE = np.uint64(1)


@njit(cache=True, nogil=True)
def note_onsets(
    listed: Ints32,
    count: int,
    now: float,
    grace: float,
    seen: Floats,
    onset: Floats,
    held: Floats,
    before: Bytes,
    fresh: Ints32,
) -> int:
    """Since when each occupied voxel has been so; a gap shorter than ``grace`` [s] is none.

    Of the arguments:
        seen, onset: by voxel, when it was last found occupied, and since when [s]; updated.
        held: by voxel, when a person last held it [s]; for new ones never, or long ago if it was
            not seen free before: then it did not come by itself, it came to light.
        before: by voxel, its state in the last update.
        fresh: receives the voxels that are new.

    Returns:
        The number of new ones.
    """
    n = 0
    for a in range(count):
        v = listed[a]
        if now - seen[v] > grace:
            onset[v] = now
            held[v] = -np.inf if before[v] == FREE else LONG_AGO
            fresh[n] = v
            n += 1
        seen[v] = now
    return n


@njit(cache=True, nogil=True)
def belongs(
    listed: Ints32,
    count: int,
    now: float,
    grace: float,
    seen: Floats,
    core: Shorts,
    active: Bytes,
    shape: Ints,
    thing: Shorts,
) -> None:
    """To which thing each listed voxel belongs: its own, or that of a core voxel beside it.

    Noise moves a surface by a voxel; skin does not grow from skin. The answers are in ``thing``.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    for a in range(count):
        v = listed[a]
        own = core[v]
        if own > 0 and active[own]:
            thing[a] = own
            continue
        thing[a] = 0
        k = v % nz
        j = (v // nz) % ny
        i = v // (nz * ny)
        for x in range(max(i - 1, 0), min(i + 2, nx)):
            for y in range(max(j - 1, 0), min(j + 2, ny)):
                for z in range(max(k - 1, 0), min(k + 2, nz)):
                    u = (x * ny + y) * nz + z
                    c = core[u]
                    if c > 0 and active[c] and now - seen[u] <= grace:
                        thing[a] = c


@njit(cache=True, nogil=True)
def touched(
    people: Ints32,
    count: int,
    reach: int,
    least: int,
    core: Shorts,
    active: Bytes,
    touches: Ints32,
    shape: Ints,
) -> int:
    """Ends every thing to which ``least`` of ``people`` are within ``reach`` voxels.

    Of the arguments:
        touches: by thing, scratch.

    Returns:
        How many things ended.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    touches[:] = 0
    ended = 0
    for a in range(count):
        v = people[a]
        k = v % nz
        j = (v // nz) % ny
        i = v // (nz * ny)
        last = 0
        for x in range(max(i - reach, 0), min(i + reach + 1, nx)):
            for y in range(max(j - reach, 0), min(j + reach + 1, ny)):
                for z in range(max(k - reach, 0), min(k + reach + 1, nz)):
                    c = int(core[(x * ny + y) * nz + z])
                    if c != last and c > 0 and active[c]:
                        last = c  # once a voxel and thing; twice at worst, where things mix
                        touches[c] += 1
                        if touches[c] >= least:
                            active[c] = 0
                            ended += 1
    return ended


@njit(cache=True, nogil=True)
def touched_unseen(
    listed: Ints32,
    thing: Shorts,
    count: int,
    possible: Words,
    rim: int,
    active: Bytes,
    shape: Ints,
) -> int:
    """Ends every thing that somebody unseen could be at: the set reaches it or lies beside it."""
    ny, nz = shape[1], shape[2]
    ended = 0
    for a in range(count):
        c = thing[a]
        if c == 0 or not active[c]:
            continue
        v = listed[a]
        i = v // (nz * ny) + rim
        j = (v // nz) % ny + rim
        k = v % nz + rim
        found = False
        for x in range(i - 1, i + 2):
            for y in range(j - 1, j + 2):
                for z in range(k - 1, k + 2):
                    found |= ((possible[x, y, z >> 6] >> np.uint64(z & 63)) & ONE) != 0
        if found:
            active[c] = 0
            ended += 1
    return ended


@njit(cache=True, nogil=True)
def forget_free(
    cores: Ints32, count: int, state: Bytes, now: float, grace: float, seen: Floats, core: Shorts
) -> int:
    """Takes voxels out of things that have been seen free for a while; compacts ``cores``.

    Returns:
        How many are left.
    """
    n = 0
    for a in range(count):
        v = cores[a]
        if state[v] == FREE and now - seen[v] > grace:
            core[v] = 0
        elif core[v] != 0:
            cores[n] = v
            n += 1
    return n


@njit(cache=True, nogil=True)
def enclosed_piece(
    start: int,
    occupied: Bytes,
    room: Words,
    rim: int,
    shape: Ints,
    limit: int,
    mark: Ints32,
    number: int,
    large: int,
    queue: Ints32,
) -> int:
    """What hangs together around a voxel: what is occupied, and where a person could be unseen.

    Of the arguments:
        occupied: flat.
        room: the places in which a hand fits and that are not seen free, as bits; rim: of it.
        limit: more voxels than this are not small.
        mark: by voxel, the last round's number; voxels of an open or large piece get ``large``, so
            that whoever comes upon them knows.
        number: of this piece.
        queue: (at least limit + 27, or all voxels) receives the piece's voxels.

    Returns:
        Its voxels, or 0: it is large, or goes on beyond the grid.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    queue[0] = start
    mark[start] = number
    n, done = 1, 0
    open_ = False
    while done < n and n <= limit and not open_:
        v = queue[done]
        done += 1
        k = v % nz
        j = (v // nz) % ny
        i = v // (nz * ny)
        if i == 0 or j == 0 or k == 0 or i == nx - 1 or j == ny - 1 or k == nz - 1:
            open_ = True
            break
        for x in range(i - 1, i + 2):
            for y in range(j - 1, j + 2):
                for z in range(k - 1, k + 2):
                    u = (x * ny + y) * nz + z
                    if mark[u] == number:
                        continue
                    p = z + rim
                    word = room[x + rim, y + rim, p >> 6]
                    if occupied[u] == 0 and ((word >> np.uint64(p & 63)) & ONE) == 0:
                        continue
                    if mark[u] == large:
                        open_ = True
                    else:
                        mark[u] = number
                        queue[n] = u
                        n += 1
    if open_ or n > limit:
        for a in range(n):
            mark[queue[a]] = large
        return 0
    return n


@njit(cache=True, nogil=True)
def label_pieces(
    listed: Ints32,
    count: int,
    occupied: Bytes,
    shape: Ints,
    core: Shorts,
    first: int,
    queue: Ints32,
) -> int:
    """Numbers the connected pieces (26 neighbours) of occupied voxels that have no number yet.

    Returns:
        The next number to give; pieces beyond :data:`MOST_PIECES` get none.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    number = first
    for a in range(count):
        if core[listed[a]] != 0:
            continue
        if number >= MOST_PIECES:
            break
        queue[0] = listed[a]
        core[listed[a]] = number
        n, done = 1, 0
        while done < n:
            v = queue[done]
            done += 1
            k = v % nz
            j = (v // nz) % ny
            i = v // (nz * ny)
            for x in range(max(i - 1, 0), min(i + 2, nx)):
                for y in range(max(j - 1, 0), min(j + 2, ny)):
                    for z in range(max(k - 1, 0), min(k + 2, nz)):
                        u = (x * ny + y) * nz + z
                        if occupied[u] != 0 and core[u] == 0:
                            core[u] = number
                            queue[n] = u
                            n += 1
        number += 1
    return number


@njit(cache=True, nogil=True)
def small_pieces(
    people: Ints32,
    count: int,
    occupied: Bytes,
    room: Words,
    rim: int,
    shape: Ints,
    limit: int,
    mark: Ints32,
    number: int,
    large: int,
    now: float,
    held: Floats,
    starts: Ints32,
    queue: Ints32,
) -> int:
    """One voxel of every small enclosed piece; what belongs to a large one is held ``now``.

    Returns:
        How many ``starts`` there are.
    """
    n = 0
    for a in range(count):
        v = people[a]
        if mark[v] == number:
            continue
        if mark[v] != large:
            size = enclosed_piece(v, occupied, room, rim, shape, limit, mark, number, large, queue)
            if size > 0:
                starts[n] = v
                n += 1
                continue
        held[v] = now
    return n


@njit(cache=True, nogil=True)
def newcomers(
    voxels: Ints32, count: int, occupied: Bytes, trait: Bytes, shape: Ints, out: Ints32
) -> int:
    """Those voxels without ``trait`` (by voxel) that have no occupied neighbour with it.

    Returns:
        How many are in ``out``.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    n = 0
    for a in range(count):
        v = voxels[a]
        if trait[v]:
            continue
        k = v % nz
        j = (v // nz) % ny
        i = v // (nz * ny)
        known = False
        for x in range(max(i - 1, 0), min(i + 2, nx)):
            for y in range(max(j - 1, 0), min(j + 2, ny)):
                for z in range(max(k - 1, 0), min(k + 2, nz)):
                    u = (x * ny + y) * nz + z
                    known |= occupied[u] != 0 and trait[u] != 0
        if not known:
            out[n] = v
            n += 1
    return n
