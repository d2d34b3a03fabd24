"""Points that must be seen or hidden: whether a picture sees through them."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints
from armsight.mapping.kernels.pixels import NOTHING


@njit(cache=True, nogil=True)
def count_through(
    depth: Floats32, label: Bytes, pixel: Floats, limit: Floats, room: Ints
) -> tuple[int, int]:
    """Of points in a picture, how many can be judged, and how many of these are seen through.

    A point is seen through when every return about its pixel is deeper than its limit; it is not
    judged where half of these pixels or more have no return, or some lie beside the picture.

    Args:
        depth: (h, w) float32 [m].
        label: (h, w) uint8, not :data:`NOTHING` where there is a return.
        pixel: (n, 2) column and row; NaN for points that are not in view.
        limit: (n,) depths [m].
        room: (n,) how far about its pixel the point may be [px].
    """
    h, w = depth.shape
    seen = through = 0
    for k in range(pixel.shape[0]):
        if not (np.isfinite(pixel[k, 0]) and np.isfinite(pixel[k, 1])):
            continue
        u, v, r = int(np.rint(pixel[k, 0])), int(np.rint(pixel[k, 1])), room[k]
        if u < r or v < r or u + r >= w or v + r >= h:
            continue
        returns, nearest = 0, np.inf
        for y in range(v - r, v + r + 1):
            for x in range(u - r, u + r + 1):
                if label[y, x] != NOTHING:
                    returns += 1
                    nearest = min(nearest, depth[y, x])
        if 2 * returns <= (2 * r + 1) ** 2:
            continue
        seen += 1
        if nearest > limit[k]:
            through += 1
    return seen, through
