"""The same search as ``carve.py`` for a camera that stands still: all projections done beforehand.

The cubes of a camera that does not move have the same windows and depths in every frame. They are
listed once; a frame then costs the comparisons alone, in loops whose branches the processor need
not guess. The result is that of :func:`~armsight.mapping.kernels.carve.carve`, bit for bit.

A plan has four parts. ``cubes`` (n, 13) int32 are the cubes of BLOCK voxels, ``halves`` (m, 13)
those of half that edge into which some of them are divided:

* 0..3 its window in ``least``: flat index of the first pooled window, its side, columns and rows
  from there to the last one;
* 4 the depth behind which that window's least must lie to free it whole, NEVER where none can tell;
* 5..9 the same in ``nearness``: that behind which nothing inside can be free;
* 10 its first voxel along x, y, z, 9 bits each, z lowest;
* 11, 12 of a half its first lane and the end of its lanes; of a cube its first half and the end of
  its halves; of a block its row of ``blocks`` and BLOCK_ROW.

``blocks`` (k, 67) uint32 are the voxels of small blocks. What a frame costs is fetching these, so a
voxel is one word: the depth behind which its windows must lie, less that of the block, in 14 bits;
whether its windows are one row, one column farther apart than the least; the flat index of the
first of its four windows from where the block's begin, in 16 bits. The last entries of a row are
the block's depth, where its windows begin, and the least columns and rows between them (16 bits
each, rows lowest).

``lanes`` are single voxels, an array each: ``base`` uint32, ``side`` uint8, ``across``, ``down``
uint16 of its window as above; ``need`` uint16 the depth behind which all of it must lie; ``target``
int32 the voxel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Ints, Ints32, Shorts
from armsight.mapping.kernels.carve import (
    BLOCK,
    NOT_SEEN,
    SEEN,
    TOP,
    block_of_voxels,
    block_window,
    block_windows,
    divide,
    eye_of,
    first_cube,
    narrow_eye,
    view_of_cube,
)
from armsight.mapping.kernels.pooling import CELL, level_of

CUBE = 13
"""Numbers that describe a cube."""
ROW = BLOCK**3 + 3
"""Numbers that describe a block."""
MOST_VOXELS = 511
"""Voxels along an edge of the grid that a plan can count."""
NEVER = 65535
"""No depth lies behind it."""
BLOCK_ROW = -1


@njit(inline="always")
def _window(u0: int, u1: int, v0: int, v1: int, h: int, w: int) -> Any:
    """A rectangle of pixels as (first pooled window, its side, columns and rows to the last)."""
    level = level_of(u1 - u0 + 1, v1 - v0 + 1)
    side = 1 << level
    return (level * h + v0) * w + u0, side, u1 - side + 1 - u0, v1 - side + 1 - v0


@njit(inline="always")
def _describe(seen: Any, i: int, j: int, k: int, h: int, w: int, cube: Ints32) -> None:
    """Write down a cube, all but what it is divided into."""
    u0, u1, v0, v1 = seen[2], seen[3], seen[4], seen[5]
    cube[0], cube[1], cube[2], cube[3] = _window(u0, u1, v0, v1, h, w)
    cube[4] = min(seen[6], NEVER) if seen[1] else NEVER
    cells = (h + CELL - 1) // CELL, (w + CELL - 1) // CELL
    cube[5], cube[6], cube[7], cube[8] = _window(
        u0 // CELL, u1 // CELL, v0 // CELL, v1 // CELL, cells[0], cells[1]
    )
    cube[9] = NEVER - 1 - seen[7] if seen[0] == SEEN else NEVER
    cube[10] = (i << 18) | (j << 9) | k


@njit(inline="always")
def _pack_block(window: Ints32, level: int, h: int, w: int, row: Any) -> bool:
    """Write down a block's windows; whether they fit."""
    left, right, upper, lower, need = window[0], window[1], window[2], window[3], window[4]
    u, v, depth = left.min(), upper.min(), need.min()
    across, down = (right - left).min(), (lower - upper).min()
    row[BLOCK**3] = depth
    row[BLOCK**3 + 1] = (level * h + v) * w + u
    row[BLOCK**3 + 2] = (across << 16) | down
    fits = 0 <= across < 65536 and 0 <= down < 65536
    for m in range(BLOCK**3):
        at = (upper[m] - v) * w + left[m] - u
        wider = right[m] - left[m] - across
        higher = lower[m] - upper[m] - down
        more = need[m] - depth
        fits &= at < 65536 and wider < 2 and higher < 2 and more < 16384
        row[m] = (more << 18) | (higher << 17) | (wider << 16) | at
    return fits


@njit(inline="always")
def _add_lanes(
    eye: Any, i: int, j: int, k: int, center: Floats, node: Ints, place: Floats,
    nx: int, ny: int, nz: int, h: int, w: int, lanes: Any, n: int,
) -> int:  # fmt: skip
    """Write the voxels of a half from lane n on, as far as there is room; returns the next lane."""
    base, side, across, down, need, target = lanes
    x, y, z = center[0], center[1], center[2]
    for a in range(divide(eye, node, place, 0, i, j, k, BLOCK // 2, x, y, z, nx, ny, nz)):
        seen = view_of_cube(eye, place[a, 0], place[a, 1], place[a, 2], 1)
        if seen[0] != SEEN or not seen[1]:
            continue
        if n < target.shape[0]:
            first, wide, right, lower = _window(seen[2], seen[3], seen[4], seen[5], h, w)
            base[n], side[n], across[n], down[n] = first, wide, right, lower
            need[n] = min(seen[6], NEVER)
            target[n] = (node[a, 0] * ny + node[a, 1]) * nz + node[a, 2]
        n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def plan_carving(
    h: int,
    w: int,
    units: float,
    lens: Floats,
    T: Floats,
    origin: Floats,
    voxel: float,
    shape: Ints,
    near: float,
    noise: Floats,
    sigmas: float,
    cubes: Ints32,
    halves: Ints32,
    blocks: Any,
    lanes: Any,
) -> tuple[int, int, int, int]:
    """List the cubes and voxels that a camera may ever see through.

    Of the arguments:
        h, w: of the pooled tables; the others as in ``carve``.
        cubes, halves, blocks, lanes: out. What finds no room is counted.

    Returns:
        Numbers of cubes, halves, blocks and lanes; -1 cubes where a block cannot be packed.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    eye = eye_of(lens, T, voxel, near, noise, sigmas, units, h, w)
    lens32, noise32, units32, behind = narrow_eye(eye)
    offset, _ = block_of_voxels(eye, ny, nz)
    window = np.empty((5, BLOCK**3), np.int32)
    center, reach = np.empty(3, np.float32), np.empty(2, np.float32)
    tops, quads = np.empty((8, 4), np.int64), np.empty((8, 3), np.float64)
    stack, place = np.empty((8, 4), np.int64), np.empty((8, 3), np.float64)
    voxels, places = np.empty((8, 4), np.int64), np.empty((8, 3), np.float64)
    spare, spare_row = np.empty(CUBE, np.int32), np.empty(ROW, np.uint32)
    count, half, block, lane = 0, 0, 0, 0
    rows, columns = (ny + TOP - 1) // TOP, (nz + TOP - 1) // TOP
    for top in range((nx + TOP - 1) // TOP * rows * columns):
        # from the same cubes down as in the search, or the places of voxels were rounded otherwise
        i, j, k = top // (rows * columns), top // columns % rows, top % columns
        i, j, k = TOP * i, TOP * j, TOP * k
        first_cube(T, origin, voxel, i, j, k, tops, quads)
        x, y, z = quads[0, 0], quads[0, 1], quads[0, 2]
        for t in range(divide(eye, tops, quads, 0, i, j, k, TOP, x, y, z, nx, ny, nz)):
            i, j, k = tops[t, 0], tops[t, 1], tops[t, 2]
            x, y, z = quads[t, 0], quads[t, 1], quads[t, 2]
            seen = view_of_cube(eye, x, y, z, BLOCK)
            if seen[0] == NOT_SEEN:
                continue
            cube = cubes[count] if count < cubes.shape[0] else spare
            count += 1
            _describe(seen, i, j, k, h, w, cube)
            level = -1
            if seen[1] and i + BLOCK <= nx and j + BLOCK <= ny and k + BLOCK <= nz:
                eu, ev, level = block_window(eye, seen, BLOCK)
            if level >= 0:
                center[0], center[1], center[2] = x, y, z
                reach[0], reach[1] = eu, ev
                block_windows(
                    1 << level, units32, lens32, noise32, offset, behind, center, reach, window
                )
                row = blocks[block] if block < blocks.shape[0] else spare_row
                if not _pack_block(window, level, h, w, row):
                    return -1, 0, 0, 0
                cube[11], cube[12] = block, BLOCK_ROW
                block += 1
                continue
            cube[11] = half
            for a in range(divide(eye, stack, place, 0, i, j, k, BLOCK, x, y, z, nx, ny, nz)):
                u, v, s = stack[a, 0], stack[a, 1], stack[a, 2]
                seen = view_of_cube(eye, place[a, 0], place[a, 1], place[a, 2], BLOCK // 2)
                if seen[0] == NOT_SEEN:
                    continue
                part = halves[half] if half < halves.shape[0] else spare
                half += 1
                _describe(seen, u, v, s, h, w, part)
                part[11] = lane
                lane = _add_lanes(
                    eye, u, v, s, place[a], voxels, places, nx, ny, nz, h, w, lanes, lane
                )
                part[12] = lane
            cube[12] = half
    return count, half, block, lane


@njit(inline="always")
def _least_of(pooled: Shorts, w: int, base: int, side: int, across: int, down: int) -> Any:
    """Least value in a window, see :func:`_window`; few are more than three pooled ones wide."""
    # unsigned, so that no index needs a look whether it counts from the end
    a: Any = np.uint32(base)
    b, c = np.uint32(a + np.uint32(min(side, across))), np.uint32(a + np.uint32(across))
    least = min(min(pooled[a], pooled[b]), pooled[c])
    for rows in (min(side, down), down):
        step = np.uint32(rows * w)
        d, e, f = np.uint32(a + step), np.uint32(b + step), np.uint32(c + step)
        least = min(least, min(min(pooled[d], pooled[e]), pooled[f]))
    if across > 2 * side or down > 2 * side:
        for y in range(0, down + side, side):
            row = base + min(y, down) * w
            for x in range(0, across + side, side):
                least = min(least, pooled[np.uint32(row + min(x, across))])
    return least


@njit(cache=True, nogil=True)
def _split(
    table: Shorts, cubes: Ints32, first: int, listed: Ints32, n: int, passed: Ints32
) -> tuple[int, int]:
    """Split n listed cubes: all of their window in a table lies behind a depth, or not.

    Of the arguments:
        first: column of ``cubes`` in which the window begins; the depth is four on.
        listed: in and out, the others; passed: out.

    Returns:
        How many passed, and how many are left.
    """
    w, pooled = table.shape[2], table.reshape(-1)
    count, left = 0, 0
    for a in range(n):
        c = listed[a]
        base, side, across = cubes[c, first], cubes[c, first + 1], cubes[c, first + 2]
        behind = _least_of(pooled, w, base, side, across, cubes[c, first + 3]) > cubes[c, first + 4]
        passed[count] = c  # both lists are written, which costs less than a branch
        count += behind
        listed[left] = c
        left += not behind
    return count, left


@njit(cache=True, nogil=True)
def _fill(cubes: Ints32, listed: Ints32, n: int, edge: int, free: Bytes) -> None:
    """Free cubes as a whole; those that follow one another along z together."""
    nx, ny, nz = free.shape
    flat = free.reshape(-1)
    a = 0
    while a < n:
        corner = last = cubes[listed[a], 10]
        a += 1
        while a < n and (last & 511) + edge < nz and cubes[listed[a], 10] == last + edge:
            last += edge
            a += 1
        i, j, k, end = corner >> 18, (corner >> 9) & 511, corner & 511, (last & 511) + edge
        for p in range(i, min(i + edge, nx)):
            for q in range(j, min(j + edge, ny)):
                row = (p * ny + q) * nz
                for at in range(row + k, row + min(end, nz)):
                    flat[np.uint32(at)] = 1


@njit(cache=True, nogil=True)
def _judge_block(
    pooled: Shorts, w: int, blocks: Any, block: int, place: Any, first: int, flat: Bytes
) -> None:
    """Free the voxels of a block that were seen through; ``first`` is its first voxel."""
    row = blocks[block]
    depth, start, apart = row[BLOCK**3], row[BLOCK**3 + 1], row[BLOCK**3 + 2]
    across, down = np.uint32(apart >> np.uint32(16)), np.uint32(apart & np.uint32(65535))
    lower, width = np.uint32(down * np.uint32(w)), np.uint32(w)
    one, low = np.uint32(1), np.uint32(65535)
    for m in range(BLOCK**3):
        word: Any = row[np.uint32(m)]
        at = np.uint32(start + np.uint32(word & low))
        to = np.uint32(at + across + np.uint32((word >> np.uint32(16)) & one))
        under = np.uint32(lower + np.uint32(np.uint32((word >> np.uint32(17)) & one) * width))
        high = min(pooled[at], pooled[to])
        deep = min(pooled[np.uint32(at + under)], pooled[np.uint32(to + under)])
        need = np.uint32(depth + np.uint32(word >> np.uint32(18)))
        flat[np.uint32(first + place[m])] = np.uint8(np.uint32(min(high, deep)) > need)


@njit(cache=True, nogil=True)
def _judge_lanes(pooled: Shorts, w: int, lanes: Any, first: int, end: int, flat: Bytes) -> None:
    """Free the voxels of lanes that were seen through."""
    base, side, across, down, need, target = lanes
    for n in range(first, end):
        least = _least_of(pooled, w, base[n], side[n], across[n], down[n])
        flat[np.uint32(target[n])] = np.uint8(least > need[n])


@njit(cache=True, nogil=True, error_model="numpy")
def carve_as_planned(
    least: Shorts,
    nearness: Shorts,
    cubes: Ints32,
    halves: Ints32,
    blocks: Any,
    lanes: Any,
    free: Bytes,
) -> None:
    """Mark every voxel that the image saw through wholly; see ``carve``.

    Of the arguments:
        cubes, halves, blocks, lanes: of :func:`plan_carving`.
        free: (nx, ny, nz) uint8, zero on entry; set to 1.
    """
    _, ny, nz = free.shape
    w = least.shape[2]
    pooled, flat = least.reshape(-1), free.reshape(-1)
    place = np.empty(BLOCK**3, np.int32)
    for m in range(BLOCK**3):
        place[m] = (m // BLOCK**2 * ny + m // BLOCK % BLOCK) * nz + m % BLOCK
    size = max(len(cubes), len(halves))
    passed, parts = np.empty(size, np.int32), np.empty(len(halves), np.int32)
    listed = np.arange(len(cubes)).astype(np.int32)
    count, left = _split(least, cubes, 0, listed, len(cubes), passed)
    _fill(cubes, passed, count, BLOCK, free)
    _, left = _split(nearness, cubes, 5, listed, left, passed)
    n = 0
    for a in range(left):
        c = listed[a]
        begin, end = cubes[c, 11], cubes[c, 12]
        if end == BLOCK_ROW:
            corner = cubes[c, 10]
            first = ((corner >> 18) * ny + ((corner >> 9) & 511)) * nz + (corner & 511)
            _judge_block(pooled, w, blocks, begin, place, first, flat)
        else:
            for half in range(begin, end):
                parts[n] = half
                n += 1
    count, left = _split(least, halves, 0, parts, n, passed)
    _fill(halves, passed, count, BLOCK // 2, free)
    _, left = _split(nearness, halves, 5, parts, left, passed)
    for a in range(left):
        _judge_lanes(pooled, w, lanes, halves[parts[a], 11], halves[parts[a], 12], flat)
