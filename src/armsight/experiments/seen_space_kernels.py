"""Compiled judgement of space by what pictures saw of it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Mask, Pose
from armsight.mapping.snapshot import FREE, OCCUPIED

HIDDEN, PARTLY, ENTERED, THROUGH = 0, 1, 2, 3
"""What a picture saw of a cube: nothing, something, into all of it, through all of it."""
BLOCK = 4
"""Voxels along the edge of a cube that is looked at first."""
PARTS = 8
"""Small cubes along the edge of a voxel."""
NEAREST = 0.05
"""Nothing nearer to a camera is judged [m]."""
WIDEST = 4
"""Texels that a picture of a cube spans at most; larger ones use a coarser level."""


@njit(cache=True, nogil=True)
def mark(points: Floats32, origin: Floats, voxel: float, divided: Mask, state: Bytes) -> None:
    """Write OCCUPIED to the voxels that hold a point and are not divided."""
    for k in range(points.shape[0]):
        x = int(np.floor((points[k, 0] - origin[0]) / voxel))
        y = int(np.floor((points[k, 1] - origin[1]) / voxel))
        z = int(np.floor((points[k, 2] - origin[2]) / voxel))
        if x < 0 or y < 0 or z < 0:
            continue
        inside = x < state.shape[0] and y < state.shape[1] and z < state.shape[2]
        if inside and not divided[x, y, z]:
            state[x, y, z] = OCCUPIED


@njit(cache=True, nogil=True)
def thinned(points: Floats32, origin: Floats, edge: float, taken: Mask) -> Floats32:
    """The points that are the first in their cell of a lattice; those outside are left out."""
    out = np.empty_like(points)
    count = 0
    for k in range(points.shape[0]):
        x = int(np.floor((points[k, 0] - origin[0]) / edge))
        y = int(np.floor((points[k, 1] - origin[1]) / edge))
        z = int(np.floor((points[k, 2] - origin[2]) / edge))
        if x < 0 or y < 0 or z < 0:
            continue
        if x >= taken.shape[0] or y >= taken.shape[1] or z >= taken.shape[2] or taken[x, y, z]:
            continue
        taken[x, y, z] = True
        out[count] = points[k]
        count += 1
    return out[:count]


@njit(cache=True, nogil=True)
def seen_by_one(
    x: float,
    y: float,
    z: float,
    reach: float,
    T: Pose,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    last: bool,
) -> int:
    """What one picture saw of the ball of radius ``reach`` about a point.

    With ``last`` hidden is not told from seen partly, as nothing is divided further.
    """
    cz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if cz + reach < NEAREST:
        return HIDDEN
    if cz - reach < NEAREST:
        return PARTLY
    a = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / cz
    b = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / cz
    # Off the axis a ball looks larger in the picture, by at most 1 / cos.
    wide = reach * math.sqrt(1.0 + a * a + b * b) / (cz - reach)
    u, v = K[0] * a + K[2], K[1] * b + K[3]
    u0, u1 = int(np.floor(u - K[0] * wide)), int(np.ceil(u + K[0] * wide))
    v0, v1 = int(np.floor(v - K[1] * wide)), int(np.ceil(v + K[1] * wide))
    height, width = sizes[0]
    if u1 < 0 or v1 < 0 or u0 >= width or v0 >= height:
        return HIDDEN
    if u0 < 0 or v0 < 0 or u1 >= width or v1 >= height:
        return PARTLY
    level = 0
    while max(u1 - u0, v1 - v0) >> level > WIDEST:
        level += 1
    columns, begin = sizes[level, 1], begins[level]
    least, most = np.inf, 0.0
    for row in range(v0 >> level, (v1 >> level) + 1):
        for column in range(u0 >> level, (u1 >> level) + 1):
            k = begin + row * columns + column
            least = min(least, low[k])
            if least < cz - reach and (last or most >= cz - reach):
                return PARTLY
            most = max(most, high[k])
    if least > cz + reach:
        return THROUGH
    if least >= cz - reach:
        return ENTERED
    return PARTLY if most >= cz - reach else HIDDEN


@njit(cache=True, nogil=True)
def best_seen(
    x: float,
    y: float,
    z: float,
    reach: float,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    mask: int,
    last: bool,
    first: np.ndarray,
) -> tuple[int, int]:
    """The best that the pictures in a mask saw of a ball, and those that saw any of it.

    ``first`` holds the picture to begin with: the one that told enough the last time.
    """
    best, some = HIDDEN, 0
    count = views.shape[0]
    begin = first[0]
    for n in range(count):
        c = (begin + n) % count
        if mask >> c & 1:
            seen = seen_by_one(x, y, z, reach, views[c], K, low[c], high[c], sizes, begins, last)
            if seen == THROUGH or (last and seen == ENTERED):
                first[0] = c
                return seen, mask
            if seen > HIDDEN:
                some |= 1 << c
            best = max(best, seen)
    return best, some


@njit(cache=True, nogil=True)
def classify(
    state: Bytes,
    divided: Mask,
    origin: Floats,
    voxel: float,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
) -> Floats32:
    """Write FREE to voxels that are not wholly hidden; returns the hidden places within them."""
    nx, ny, nz = state.shape
    small = np.empty((PARTS, PARTS, PARTS), np.bool_)
    stack = np.empty((64, 5), np.int64)
    first = np.zeros(1, np.int64)
    room = 1 << 16
    out = np.empty((room, 3), np.float32)
    count = 0
    root3 = math.sqrt(3.0)
    edge = voxel / PARTS
    every = (1 << views.shape[0]) - 1
    for block in range(-(-nx // BLOCK) * -(-ny // BLOCK) * -(-nz // BLOCK)):
        i, rest = divmod(block, -(-ny // BLOCK) * -(-nz // BLOCK))
        j, k = divmod(rest, -(-nz // BLOCK))
        i, j, k = i * BLOCK, j * BLOCK, k * BLOCK
        h = 0.5 * BLOCK * voxel
        x0, y0, z0 = origin[0] + i * voxel, origin[1] + j * voxel, origin[2] + k * voxel
        best, mask = best_seen(
            x0 + h, y0 + h, z0 + h, root3 * h,
            views, K, low, high, sizes, begins, every, False, first,
        )  # fmt: skip
        if best == THROUGH:
            state[i : i + BLOCK, j : j + BLOCK, k : k + BLOCK] = FREE
            continue
        if mask == 0:
            continue
        for ix in range(i, min(i + BLOCK, nx)):
            for iy in range(j, min(j + BLOCK, ny)):
                for iz in range(k, min(k + BLOCK, nz)):
                    x0, y0 = origin[0] + ix * voxel, origin[1] + iy * voxel
                    z0 = origin[2] + iz * voxel
                    h = 0.5 * voxel
                    best, some = best_seen(
                        x0 + h, y0 + h, z0 + h, root3 * h,
                        views, K, low, high, sizes, begins, mask, False, first,
                    )  # fmt: skip
                    if best == THROUGH:
                        state[ix, iy, iz] = FREE
                        continue
                    if some == 0 or not divided[ix, iy, iz]:
                        continue
                    small[:] = False
                    divide_block(
                        x0, y0, z0, edge, some, small, stack,
                        views, K, low, high, sizes, begins, first,
                    )  # fmt: skip
                    if not small.any():
                        continue
                    state[ix, iy, iz] = FREE
                    if room - count < PARTS**3:
                        room *= 2
                        grown = np.empty((room, 3), np.float32)
                        grown[:count] = out[:count]
                        out = grown
                    for a in range(PARTS):
                        for b in range(PARTS):
                            for c in range(PARTS):
                                if not small[a, b, c] and open_cube(small, a, b, c):
                                    out[count, 0] = x0 + (a + 0.5) * edge
                                    out[count, 1] = y0 + (b + 0.5) * edge
                                    out[count, 2] = z0 + (c + 0.5) * edge
                                    count += 1
    return out[:count].copy()


@njit(cache=True, nogil=True)
def open_cube(small: Mask, a: int, b: int, c: int) -> bool:
    """Whether a small cube has a neighbour that is seen, or may have one in the next voxel."""
    last = PARTS - 1
    if a == 0 or b == 0 or c == 0 or a == last or b == last or c == last:
        return True
    return (
        small[a - 1, b, c]
        or small[a + 1, b, c]
        or small[a, b - 1, c]
        or small[a, b + 1, c]
        or small[a, b, c - 1]
        or small[a, b, c + 1]
    )


@njit(cache=True, nogil=True)
def divide_block(
    x0: float,
    y0: float,
    z0: float,
    edge: float,
    mask: int,
    small: Mask,
    stack: np.ndarray,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    first: np.ndarray,
) -> None:
    """Mark the small cubes of a voxel that some picture of a mask saw, block by smaller block."""
    stack[0, :3] = 0
    stack[0, 3], stack[0, 4] = PARTS, mask
    count = 1
    while count > 0:
        count -= 1
        i, j, k, width, some = stack[count]
        half = width // 2
        h = 0.5 * half * edge
        for a in range(i, i + width, half):
            for b in range(j, j + width, half):
                for c in range(k, k + width, half):
                    x, y, z = x0 + a * edge + h, y0 + b * edge + h, z0 + c * edge + h
                    best, left = best_seen(
                        x,
                        y,
                        z,
                        math.sqrt(3.0) * h,
                        views,
                        K,
                        low,
                        high,
                        sizes,
                        begins,
                        some,
                        half == 1,
                        first,
                    )
                    if best == THROUGH or (half == 1 and best == ENTERED):
                        small[a : a + half, b : b + half, c : c + half] = True
                    elif half > 1 and left != 0:
                        stack[count, 0], stack[count, 1], stack[count, 2] = a, b, c
                        stack[count, 3], stack[count, 4] = half, left
                        count += 1
