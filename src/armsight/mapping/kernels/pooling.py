"""Depth images as tables of the least and greatest depth in windows of pixels.

``units`` are depth units a metre of the uint16 tables.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats32, Ints32, Shorts

LEVELS = 5
"""Pooling windows of 1, 2, 4, 8, 16 pixels."""


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
def _most(a: Shorts, b: Shorts, out: Shorts) -> None:
    for u in range(out.shape[0]):
        out[u] = np.uint16(max(a[u], b[u]))


@njit(cache=True, nogil=True)
def pool(below: Shorts, step: int, least: bool, row: Shorts, out: Shorts) -> None:
    """Minimum (or maximum) of the windows at (v, u), (v + step, u), (v, u + step) and both.

    Windows are cut at the image's edges. ``row`` (w,) is scratch.
    """
    h, w = below.shape
    for v in range(h):
        other = below[min(v + step, h - 1)]
        if least:
            _least(below[v], other, row)
            _least(row[: w - step], row[step:], out[v, : w - step])
        else:
            _most(below[v], other, row)
            _most(row[: w - step], row[step:], out[v, : w - step])
        out[v, w - step :] = row[w - step :]


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
def build_tables(least: Shorts, most: Shorts, row: Shorts) -> None:
    """Fill levels 1.. of (5, h, w) pooled tables from level 0; windows as in :func:`pool`."""
    for k in range(1, LEVELS):
        pool(least[k - 1], 1 << (k - 1), True, row, least[k])
        pool(most[k - 1], 1 << (k - 1), False, row, most[k])


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


@njit(inline="always")
def window_most(table: Shorts, u0: int, u1: int, v0: int, v1: int) -> int:
    """Maximum over an inclusive pixel rectangle inside the image, from pooled tables."""
    k = level_of(u1 - u0 + 1, v1 - v0 + 1)
    s = 1 << k
    pooled = table[k]
    best = pooled[v0, u0]
    v = v0
    while True:
        u = u0
        while True:
            d = pooled[v, u]
            if d > best:
                best = d
            if u + s > u1:
                break
            u = min(u + s, u1 - s + 1)
        if v + s > v1:
            break
        v = min(v + s, v1 - s + 1)
    return int(best)
