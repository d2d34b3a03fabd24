"""Compiled drawing of an arm over a recorded depth picture."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints

AGAIN = 0.3
"""Share of the sensor's noise that a recorded picture is given anew: it has its own already."""


@njit(cache=True, nogil=True)
def draw(
    recorded: Floats32,
    noise: Floats32,
    sigma: tuple[float, float, float],
    points: Floats,
    faces: Ints,
    lens: tuple[float, float, float, float],
    out: Floats32,
) -> None:
    """Put triangles before a picture, each pixel showing what is nearest.

    Args:
        recorded: (h, w) depth [m], NaN where there is no return.
        noise: (h, w) of standard deviation 1.
        sigma: a, b, c of a + b z + c z^2 [m].
        points: (n, 3) in the camera's frame [m].
        faces: (m, 3) indices of the triangles' corners.
        lens: fx, fy, cx, cy [px], without distortion.
        out: (h, w) the picture.
    """
    fx, fy, cx, cy = lens
    height, width = out.shape
    for v in range(height):
        for u in range(width):
            out[v, u] = np.inf
    for f in range(faces.shape[0]):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        if min(a[2], b[2], c[2]) < 0.05:
            continue
        ua, va = fx * a[0] / a[2] + cx, fy * a[1] / a[2] + cy
        ub, vb = fx * b[0] / b[2] + cx, fy * b[1] / b[2] + cy
        uc, vc = fx * c[0] / c[2] + cx, fy * c[1] / c[2] + cy
        area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
        if area == 0.0:
            continue
        left = max(math.ceil(min(ua, ub, uc)), 0)
        right = min(math.floor(max(ua, ub, uc)), width - 1)
        top = max(math.ceil(min(va, vb, vc)), 0)
        bottom = min(math.floor(max(va, vb, vc)), height - 1)
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                wa = ((ub - u) * (vc - v) - (uc - u) * (vb - v)) / area
                wb = ((uc - u) * (va - v) - (ua - u) * (vc - v)) / area
                wc = 1.0 - wa - wb
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                z = 1.0 / (wa / a[2] + wb / b[2] + wc / c[2])
                out[v, u] = min(out[v, u], z)
    for v in range(height):
        for u in range(width):
            z, share = recorded[v, u], AGAIN
            if out[v, u] < z or (math.isnan(z) and out[v, u] < np.inf):
                z, share = out[v, u], 1.0
            out[v, u] = z + share * noise[v, u] * (sigma[0] + sigma[1] * z + sigma[2] * z * z)
