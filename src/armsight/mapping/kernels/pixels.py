"""Which pixels of a depth image can be used, and which show a surface."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats32

NOTHING, VALID, ROBOT = 0, 1, 2
"""Labels of pixels: no usable return, something, the arm itself."""


@njit(cache=True, nogil=True)
def label_valid(depth: Floats32, near: float, far: float, label: Bytes) -> int:
    """Mark the pixels with a usable return; returns how many there are."""
    d = depth.reshape(-1)
    out = label.reshape(-1)
    lo, hi = np.float32(near), np.float32(far)
    count = 0
    for p in range(d.shape[0]):
        ok = (d[p] >= lo) & (d[p] <= hi)  # false for NaN and infinities
        out[p] = np.uint8(ok)
        count += ok
    return count


@njit(cache=True, nogil=True)
def keep_valid(depth: Floats32, label: Bytes, out: Floats32) -> None:
    """The depths of pixels with a usable return, NaN elsewhere."""
    d, seen, o = depth.reshape(-1), label.reshape(-1), out.reshape(-1)
    nothing = np.float32(np.nan)
    for p in range(d.shape[0]):
        o[p] = d[p] if seen[p] == VALID else nothing


@njit(cache=True, nogil=True)
def trusted(
    depth: Floats32, label: Bytes, v: int, u: int, like: float, exact: float, need: int
) -> bool:
    """Whether a pixel shows a surface and not the mixture of two.

    At the border of something near, a pixel may see both it and what is behind, and report a depth
    in between where nothing is ("flying" pixels). A pixel is not trusted if

    * fewer than ``need`` of its 8 neighbours lie within ``like`` [m] of its depth. Those of the
      arm do not count where something nearer is beside the pixel: it may be that thing's border,
      with more of the arm behind it in it, or
    * one neighbour is nearer and another farther than that (0, a negative or an infinite depth is
      no return, as NaN is: it is neither), or
    * the arm is seen beside it, nearer than it, unless the two pixels on the other side continue to
      its depth within ``exact`` [m]: then it is the same surface, or a mixture that is wrong by no
      more than that, or
    * the arm is seen two pixels away, nearer than it, and the pixel between is not of a like depth.
    """
    h, w = depth.shape
    z = depth[v, u]
    found = 0
    arm = 0
    nearer = False
    farther = False
    for y in range(max(v - 1, 0), min(v + 2, h)):
        for x in range(max(u - 1, 0), min(u + 2, w)):
            there = depth[y, x]
            if not (there > 0.0 and there < np.inf):  # true for NaN
                continue
            d = there - z
            if abs(d) <= like:
                found += 1
                arm += label[y, x] == ROBOT
            elif d > like:
                farther = True
            elif d < -like:
                nearer = True
    if nearer:
        found -= arm
    if found <= need or (nearer and farther):  # the pixel itself was counted
        return False
    for y in range(max(v - 2, 0), min(v + 3, h)):
        for x in range(max(u - 2, 0), min(u + 3, w)):
            if label[y, x] != ROBOT or depth[y, x] >= z:
                continue
            dy, dx = min(max(y - v, -1), 1), min(max(x - u, -1), 1)
            if abs(y - v) == 2 or abs(x - u) == 2:
                between, d = label[v + dy, u + dx], depth[v + dy, u + dx]
                if between == ROBOT and d < z:
                    continue  # that one is judged itself
                if between != VALID or not abs(d - z) <= like:
                    return False
                continue
            b, a = v - 2 * dy, u - 2 * dx
            if not (0 <= b < h and 0 <= a < w):
                return False
            if label[b, a] != VALID or label[v - dy, u - dx] != VALID:
                return False
            if not abs(2.0 * depth[v - dy, u - dx] - depth[b, a] - z) <= exact:
                return False
    return True
