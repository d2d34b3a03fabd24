"""Compiled correction of depth images by what calibration found of the camera's errors."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats32


@njit(cache=True, nogil=True)
def correct_depth(
    depth: Floats32, surface: Floats32, true: Floats32, first: float, step: float, out: Floats32
) -> None:
    """True depth of each measured one, by :class:`~armsight.devices.depth_model.DepthCorrection`.

    Of the arguments:
        depth: (h, w) as measured [m]; what is not a depth stays as it is.
        surface: (h, w) the place's share of the error [m].
        true: (t,) true depth of measured ones, ``step`` apart from ``first`` on [m].
        out: (h, w) float32.
    """
    last = np.float32(true.shape[0] - 1)
    per_step, begin = np.float32(1.0 / step), np.float32(first)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            at = (depth[v, u] - surface[v, u] - begin) * per_step
            if at >= np.float32(0.0) and at < last:
                low = int(at)
                share = at - np.float32(low)
                out[v, u] = true[low] + share * (true[low + 1] - true[low])
            else:
                out[v, u] = depth[v, u]
