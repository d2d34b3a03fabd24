"""Edges along the normals of projected curves, and the lens that projects them."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32


@njit(cache=True, nogil=True)
def edge_search(
    gx: Floats32,
    gy: Floats32,
    pixels: Floats,
    normals: Floats,
    reach: float,
    width: float,
    least: float,
    cos_least: float,
) -> tuple[Floats, Floats]:
    """Edges along the normals of projected curves.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        pixels: (n, 2) where the curve is expected.
        normals: (n, 2) unit normals in the picture.
        reach: how far to search to both sides [px].
        width: nearer crests are preferred on this scale [px].
        least: crests below this are none [levels/px].
        cos_least: cosine of the greatest angle between gradient and normal.

    Returns:
        (n,) signed distance of the edge along the normal [px], NaN for none; (n,) its gradient
        along the normal [levels/px].
    """
    h, w = gx.shape
    n = len(pixels)
    offset = np.full(n, np.nan)
    strength = np.zeros(n)
    step = 0.5
    half = int(np.ceil(reach / step))
    count = 2 * half + 1
    along = np.zeros(count + 4)
    rise = np.zeros(count + 4)
    size = np.zeros(count + 4)
    for i in range(n):
        nx, ny = normals[i, 0], normals[i, 1]
        far = reach + 2.5
        u, v = pixels[i, 0], pixels[i, 1]
        if not (far < u < w - 1 - far and far < v < h - 1 - far):
            continue
        for k in range(count + 4):
            d = (k - half - 2) * step
            x, y = u + d * nx, v + d * ny
            x0, y0 = int(x), int(y)
            fx, fy = x - x0, y - y0
            w00, w01, w10, w11 = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
            a = w00 * gx[y0, x0] + w01 * gx[y0, x0 + 1]
            a += w10 * gx[y0 + 1, x0] + w11 * gx[y0 + 1, x0 + 1]
            b = w00 * gy[y0, x0] + w01 * gy[y0, x0 + 1]
            b += w10 * gy[y0 + 1, x0] + w11 * gy[y0 + 1, x0 + 1]
            rise[k] = a * nx + b * ny
            along[k] = abs(rise[k])
            size[k] = np.sqrt(a * a + b * b)
        best = 0.0
        for k in range(2, count + 2):
            p, q, r = along[k - 1], along[k], along[k + 1]
            if q < least or q < p or q <= r or q < cos_least * size[k]:
                continue
            d = (k - half - 2) * step
            value = q * np.exp(-0.5 * (d / width) ** 2)
            if value > best:
                best = value
                # Samples a whole pixel apart are interpolated alike; half a pixel apart they are
                # not, and the crest would be drawn to the middle of a pixel.
                p, r = along[k - 2], along[k + 2]
                bend = p - 2 * q + r
                offset[i] = d + (0.5 * (p - r) / bend if bend < -1e-12 else 0.0)
                strength[i] = rise[k]
    return offset, strength


@njit(cache=True, nogil=True)
def project_lens(lens: Floats, x: float, y: float, z: float) -> tuple[float, float]:
    """Pixel of a point in front of a lens: fx, fy, cx, cy, k1, k2, p1, p2, k3 (OpenCV's)."""
    a, b = x / z, y / z
    r2 = a * a + b * b
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    u = a * radial + 2 * lens[6] * a * b + lens[7] * (r2 + 2 * a * a)
    v = b * radial + lens[6] * (r2 + 2 * b * b) + 2 * lens[7] * a * b
    return lens[0] * u + lens[2], lens[1] * v + lens[3]
