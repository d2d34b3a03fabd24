"""Depth images as tables of the least depth, and the least nearness, in windows of pixels.

Nearness is how far a depth stays below the greatest that a table can hold, so that what the
greatest depth is asked for is asked of another table of least values.

``units`` are depth units a metre of the uint16 tables.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats32, Ints32, Shorts

LEVELS = 5
"""Pooling windows of 1, 2, 4, 8, 16 pixels."""
CELL = 8
"""Edge of the squares of which the nearness is known [px]."""
FARTHEST = 65535
"""The greatest depth that a table can hold [units]."""


@njit(cache=True, nogil=True)
def to_units(depth: Floats32, label: Bytes, units: float, out: Shorts) -> None:
    """Depth as uint16, rounded down; 0 where there is no usable return."""
    d = depth.reshape(-1)
    seen = label.reshape(-1)
    o = out.reshape(-1)
    scale = np.float32(units)
    for p in range(d.shape[0]):
        z = d[p] if seen[p] != 0 else np.float32(0.0)
        o[p] = np.uint16(np.int32(z * scale))


@njit(cache=True, nogil=True)
def _least(a: Shorts, b: Shorts, out: Shorts) -> None:
    for u in range(out.shape[0]):
        out[u] = np.uint16(min(a[u], b[u]))


@njit(cache=True, nogil=True)
def _pool_row(upper: Shorts, lower: Shorts, step: int, row: Shorts, out: Shorts) -> None:
    """One row of :func:`pool`, from the two that its windows begin in."""
    inner = max(row.shape[0] - step, 0)
    _least(upper, lower, row)
    _least(row[:inner], row[step:], out[:inner])
    out[inner:] = row[inner:]


@njit(cache=True, nogil=True)
def pool(below: Shorts, step: int, row: Shorts, out: Shorts) -> None:
    """Minimum of the windows at (v, u), (v + step, u), (v, u + step) and both.

    Windows are cut at the image's edges. ``row`` (w,) is scratch. ``out`` may be ``below``.
    """
    h = below.shape[0]
    for v in range(h):
        _pool_row(below[v], below[min(v + step, h - 1)], step, row, out[v])


@njit(cache=True, nogil=True)
def gather(windows: Shorts, index: Ints32, out: Shorts) -> None:
    """Out = windows[index], 0 where the index is negative: an image seen through an ideal lens."""
    src = windows.reshape(-1)
    at = index.reshape(-1)
    o = out.reshape(-1)
    for p in range(at.shape[0]):
        i = at[p]
        o[p] = src[i] if i >= 0 else np.uint16(0)


@njit(cache=True, nogil=True)
def build_tables(table: Shorts, row: Shorts) -> None:
    """Fill levels 1.. of (5, h, w) pooled tables from level 0; windows as in :func:`pool`.

    From the last row up, all levels of it at once: what they are made of is still at hand.
    """
    h = table.shape[1]
    for v in range(h - 1, -1, -1):
        for k in range(1, LEVELS):
            step, below = 1 << (k - 1), table[k - 1]
            _pool_row(below[v], below[min(v + step, h - 1)], step, row, table[k, v])


@njit(cache=True, nogil=True)
def nearness_of_cells(image: Shorts, row: Shorts, out: Shorts) -> None:
    """Least nearness in the squares of CELL pixels of an (h, w) image; ``row`` (w,) is scratch."""
    h, w = image.shape
    for y in range(out.shape[0]):
        for u in range(w):
            row[u] = image[CELL * y, u]
        for v in range(CELL * y + 1, min(CELL * (y + 1), h)):
            for u in range(w):
                row[u] = max(row[u], image[v, u])
        for x in range(out.shape[1]):
            found = row[CELL * x]
            for u in range(CELL * x + 1, min(CELL * (x + 1), w)):
                found = max(found, row[u])
            out[y, x] = FARTHEST - found


@njit(inline="always")
def level_of(width: int, height: int) -> int:
    """The pooled table whose windows are the largest that fit into a rectangle of pixels."""
    short = min(width, height)
    k = 0
    if short >= 16:
        k = 4
    elif short >= 8:
        k = 3
    elif short >= 4:
        k = 2
    elif short >= 2:
        k = 1
    return k


@njit(inline="always")
def window_least(table: Shorts, u0: int, u1: int, v0: int, v1: int) -> int:
    """Minimum over an inclusive pixel rectangle inside the image, from pooled tables."""
    k = level_of(u1 - u0 + 1, v1 - v0 + 1)
    s = 1 << k
    pooled = table[k]
    best = pooled[v0, u0]
    v = v0
    while True:
        u = u0
        while True:
            d = pooled[v, u]
            if d < best:  # not min(): it would widen the type
                best = d
            if u + s > u1:
                break
            u = min(u + s, u1 - s + 1)
        if v + s > v1:
            break
        v = min(v + s, v1 - s + 1)
    return int(best)
