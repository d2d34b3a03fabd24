"""The same search as ``carve.py`` for a camera that stands still: all projections done beforehand.

The octree of a camera that does not move has the same windows and depths in every frame. They are
listed once, parents before their children; a frame then costs the comparisons alone. The result is
that of :func:`~armsight.mapping.kernels.carve.carve`, bit for bit.

A plan has three parts. ``nodes`` (n, 11) int32 are cubes:

* 0..3 first and last column, first and last row of its window;
* 4 the depth behind which the window's least must lie to free it whole, -1 where none can tell;
* 5 the depth up to which the greatest must not lie if anything inside is to be free, -1 likewise;
* 6 where the list goes on when nothing inside is of interest;
* 7 its first voxel along x, y, z and its edge, 9 + 9 + 9 + 4 bits, the edge lowest;
* 8 the first row of ``blocks`` or of ``lanes`` that belongs to it;
* 9 of a block the flat index in the pooled tables where its windows begin, otherwise the end of its
  lanes;
* 10 of a block the least columns and rows between its pooled windows, 8 + 8 bits, rows lowest;
  -1 where the cube is none.

``blocks`` (m, 64) uint32 are the voxels of small blocks. What a frame costs is fetching these, so a
voxel is one word: the depth behind which its windows must lie, less that of the block, in 16 bits;
whether its windows are one row, one column farther apart than the least; row and column of the
first of its four windows from where the block's begin, 7 bits each, the column lowest. The depth of
the block is the row's last entry, ``blocks[:, 64]``.

``lanes`` are voxels of which each has a window of its own, an array each: ``base`` uint32 the flat
index of the first of its four windows; ``across``, ``down`` uint8 columns and rows on which the
others begin; ``need`` uint16 the depth behind which all must lie; ``target`` int32 the voxel.
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
from armsight.mapping.kernels.pooling import level_of, window_least, window_most

NODE = 11
"""Numbers that describe a cube."""
ROW = BLOCK**3 + 1
"""Numbers that describe a block."""
MOST_VOXELS = 511
"""Voxels along an edge of the grid that a plan can count."""


@njit(inline="always")
def _add_lane(lanes: Any, n: int, base: int, across: int, down: int, need: int, target: int) -> int:
    """Write lane n, if there is room for it; returns the next."""
    bases, acrosses, downs, needs, targets = lanes
    if n < bases.shape[0]:
        bases[n] = base
        acrosses[n] = across
        downs[n] = down
        needs[n] = min(need, 65535)  # nothing lies behind that either
        targets[n] = target
    return n + 1


@njit(inline="always")
def _lane_of_voxel(lanes: Any, n: int, seen: Any, h: int, w: int, target: int) -> int:
    """A lane of a single voxel; none is written where four windows do not make up its own."""
    u0, u1, v0, v1 = seen[2], seen[3], seen[4], seen[5]
    level = level_of(u1 - u0 + 1, v1 - v0 + 1)
    side = 1 << level
    if u1 - u0 + 1 > 2 * side or v1 - v0 + 1 > 2 * side:
        return n
    base = (level * h + v0) * w + u0
    return _add_lane(lanes, n, base, u1 - side + 1 - u0, v1 - side + 1 - v0, seen[6], target)


@njit(inline="always")
def _block_row(window: Ints32, row: Any) -> Any:
    """Pack a block's windows.

    Returns:
        (whether they fit, first column, first row, least columns and least rows between windows).
    """
    left, right, upper, lower, need = window[0], window[1], window[2], window[3], window[4]
    u, v, depth = left.min(), upper.min(), need.min()
    across, down = (right - left).min(), (lower - upper).min()
    row[BLOCK**3] = depth
    fits = 0 <= across < 256 and 0 <= down < 256
    for m in range(BLOCK**3):
        du, dv = left[m] - u, upper[m] - v
        wider = right[m] - left[m] - across
        higher = lower[m] - upper[m] - down
        more = need[m] - depth
        fits &= du < 128 and dv < 128 and wider < 2 and higher < 2 and more < 65536
        row[m] = (more << 16) | (higher << 15) | (wider << 14) | (dv << 7) | du
    return fits, u, v, across, down


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
    nodes: Ints32,
    blocks: Any,
    lanes: Any,
) -> tuple[int, int, int]:
    """List the cubes and voxels that a camera may ever see through.

    Of the arguments:
        h, w: of the pooled tables; the others as in ``carve``.
        nodes, blocks: out; lanes: (base, across, down, need, target) out. What finds no room is
            counted.

    Returns:
        Numbers of nodes, blocks and lanes; -1 nodes where a block cannot be packed.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    eye = eye_of(lens, T, voxel, near, noise, sigmas, units, h, w)
    lens32, noise32, units32, behind = narrow_eye(eye)
    offset, _ = block_of_voxels(eye, ny, nz)
    window = np.empty((5, BLOCK**3), np.int32)
    center, reach = np.empty(3, np.float32), np.empty(2, np.float32)
    stack = np.empty((64, 4), np.int64)
    place = np.empty((64, 3), np.float64)
    spare_node = np.empty((1, NODE), np.int32)
    spare_row = np.empty((1, ROW), np.uint32)
    count, block, lane = 0, 0, 0
    rows, columns = (ny + TOP - 1) // TOP, (nz + TOP - 1) // TOP
    for top in range(((nx + TOP - 1) // TOP) * rows * columns):
        bi, bj, bk = top // (rows * columns), top // columns % rows, top % columns
        first_cube(T, origin, voxel, bi * TOP, bj * TOP, bk * TOP, stack, place)
        n = 1
        while n > 0:
            n -= 1
            i, j, k, s = stack[n, 0], stack[n, 1], stack[n, 2], stack[n, 3]
            x, y, z = place[n, 0], place[n, 1], place[n, 2]
            seen = view_of_cube(eye, x, y, z, s)
            if seen[0] == NOT_SEEN or (s == 1 and not seen[1]):
                continue
            node = nodes[count] if count < nodes.shape[0] else spare_node[0]
            count += 1
            node[0], node[1], node[2], node[3] = seen[2], seen[3], seen[4], seen[5]
            node[4] = seen[6] if seen[1] else -1
            node[5] = seen[7] if seen[0] == SEEN and s > 1 else -1
            node[7] = (i << 22) | (j << 13) | (k << 4) | s
            node[8] = lane
            node[10] = -1
            inside = i + s <= nx and j + s <= ny and k + s <= nz
            level = -1
            if s == BLOCK and seen[1] and inside:
                eu, ev, level = block_window(eye, seen, s)
            if level >= 0:
                center[0], center[1], center[2] = x, y, z
                reach[0], reach[1] = eu, ev
                block_windows(
                    1 << level, units32, lens32, noise32, offset, behind, center, reach, window
                )
                row = blocks[block] if block < blocks.shape[0] else spare_row[0]
                fits, u, v, across, down = _block_row(window, row)
                if not fits:
                    return -1, 0, 0
                node[8] = block
                node[9] = (level * h + v) * w + u
                node[10] = (across << 8) | down
                block += 1
                continue
            if s > 1:
                bottom = n
                n = divide(eye, stack, place, n, i, j, k, s, x, y, z, nx, ny, nz)
            if s == 2:  # single voxels become lanes where they can
                kept = bottom
                for m in range(bottom, n):
                    seen = view_of_cube(eye, place[m, 0], place[m, 1], place[m, 2], 1)
                    if seen[0] != SEEN or not seen[1]:
                        continue
                    target = (stack[m, 0] * ny + stack[m, 1]) * nz + stack[m, 2]
                    before = lane
                    lane = _lane_of_voxel(lanes, lane, seen, h, w, target)
                    if lane == before:
                        for d in range(4):
                            stack[kept, d] = stack[m, d]
                        for d in range(3):
                            place[kept, d] = place[m, d]
                        kept += 1
                n = kept
            node[9] = lane
    _link(nodes[: min(count, nodes.shape[0])])
    return count, block, lane


@njit(cache=True, nogil=True)
def _link(nodes: Ints32) -> None:
    """For each cube the next one in the list that is not inside it: the next that is as large."""
    following = np.full(TOP + 1, nodes.shape[0], np.int64)  # by edge: the next at least as large
    for n in range(nodes.shape[0] - 1, -1, -1):
        s = nodes[n, 7] & 15
        nodes[n, 6] = following[s]
        for edge in range(s + 1):
            following[edge] = n


@njit(cache=True, nogil=True)
def _fill(flat: Bytes, ny: int, nz: int, first: int, a: int, b: int, c: int) -> None:
    """Free a box of a x b x c voxels from flat index ``first`` on."""
    for p in range(a):
        for q in range(b):
            at: Any = np.uint32(first + (p * ny + q) * nz)
            if c == 8:  # becomes one store
                for r in range(8):
                    flat[at + np.uint32(r)] = 1
            elif c == 4:
                for r in range(4):
                    flat[at + np.uint32(r)] = 1
            else:
                for r in range(c):
                    flat[at + np.uint32(r)] = 1


@njit(cache=True, nogil=True)
def _judge_lanes(
    pooled: Shorts,
    w: int,
    bases: Any,
    acrosses: Any,
    downs: Any,
    needs: Shorts,
    targets: Ints32,
    first: int,
    end: int,
    flat: Bytes,
) -> None:
    """Free the voxels of lanes that were seen through."""
    width = np.uint32(w)
    for n in range(first, end):
        # unsigned, so that no index needs a look whether it counts from the end
        a: Any = np.uint32(bases[n])
        b: Any = np.uint32(a + np.uint32(acrosses[n]))
        down: Any = np.uint32(np.uint32(downs[n]) * width)
        upper = min(pooled[a], pooled[b])
        lower = min(pooled[np.uint32(a + down)], pooled[np.uint32(b + down)])
        flat[np.uint32(targets[n])] = np.uint8(min(upper, lower) > needs[n])


@njit(cache=True, nogil=True)
def _judge_block(
    pooled: Shorts,
    w: int,
    blocks: Any,
    block: int,
    begin: int,
    apart: int,
    place: Ints32,
    first: int,
    flat: Bytes,
) -> None:
    """Free the voxels of a block that were seen through; ``first`` is its first voxel."""
    width = np.uint32(w)
    b = np.uint32(block)
    start, across, down = np.uint32(begin), np.uint32(apart >> 8), np.uint32(apart & 255)
    depth = np.uint32(blocks[b, np.uint32(BLOCK**3)])
    one, low = np.uint32(1), np.uint32(127)
    for m in range(BLOCK**3):
        word: Any = np.uint32(blocks[b, np.uint32(m)])
        row = np.uint32((word >> np.uint32(7)) & low)
        at = np.uint32(start + np.uint32(row * width) + np.uint32(word & low))
        to = np.uint32(at + across + np.uint32((word >> np.uint32(14)) & one))
        lower = np.uint32(np.uint32(down + np.uint32((word >> np.uint32(15)) & one)) * width)
        high = min(pooled[at], pooled[to])
        deep = min(pooled[np.uint32(at + lower)], pooled[np.uint32(to + lower)])
        need = np.uint32(depth + np.uint32(word >> np.uint32(16)))
        flat[np.uint32(first + place[m])] = np.uint8(np.uint32(min(high, deep)) > need)


@njit(cache=True, nogil=True, error_model="numpy")
def carve_as_planned(
    least: Shorts, most: Shorts, nodes: Ints32, blocks: Any, lanes: Any, free: Bytes
) -> None:
    """Mark every voxel that the image saw through wholly; see ``carve``.

    Of the arguments:
        least, most: (5, h, w) uint16 pooled tables of an image.
        nodes, blocks, lanes: of :func:`plan_carving`.
        free: (nx, ny, nz) uint8, zero on entry; set to 1.
    """
    nx, ny, nz = free.shape
    w = least.shape[2]
    bases, acrosses, downs, needs, targets = lanes
    pooled = least.reshape(-1)
    flat = free.reshape(-1)
    place = np.empty(BLOCK**3, np.int32)
    for m in range(BLOCK**3):
        place[m] = ((m // BLOCK**2) * ny + m // BLOCK % BLOCK) * nz + m % BLOCK
    n = 0
    while n < nodes.shape[0]:
        # element by element: taking the row would cost more than reading it
        u0, u1, v0, v1 = nodes[n, 0], nodes[n, 1], nodes[n, 2], nodes[n, 3]
        need, first = nodes[n, 4], nodes[n, 5]
        cube = nodes[n, 7]
        i, j, k, s = cube >> 22, (cube >> 13) & 511, (cube >> 4) & 511, cube & 15
        if need >= 0 and window_least(least, u0, u1, v0, v1) > need:
            a, b, c = min(s, nx - i), min(s, ny - j), min(s, nz - k)
            _fill(flat, ny, nz, (i * ny + j) * nz + k, a, b, c)
            n = nodes[n, 6]
            continue
        if first >= 0 and window_most(most, u0, u1, v0, v1) <= first:
            n = nodes[n, 6]
            continue
        start, end, apart = nodes[n, 8], nodes[n, 9], nodes[n, 10]
        if apart >= 0:
            voxel = (i * ny + j) * nz + k
            _judge_block(pooled, w, blocks, start, end, apart, place, voxel, flat)
        elif start < end:
            _judge_lanes(pooled, w, bases, acrosses, downs, needs, targets, start, end, flat)
        n += 1
