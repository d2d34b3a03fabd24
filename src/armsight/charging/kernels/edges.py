"""Edges along the normals of projected curves, and the lens that projects them."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, SignedShorts

FINE = 0.5
"""Between samples along a normal [px]; a rough search takes twice as much."""


@njit(cache=True, nogil=True)
def edge_search(
    gx: Floats32 | SignedShorts,
    gy: Floats32 | SignedShorts,
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
    n = len(pixels)
    offset, strength = np.full(n, np.nan), np.zeros(n)
    room = np.empty((2, sample_room(reach)))
    for i in range(n):
        line = (pixels[i, 0], pixels[i, 1], normals[i, 0], normals[i, 1])
        offset[i], strength[i] = edge_along(gx, gy, line, reach, 2, width, least, cos_least, room)
    return offset, strength


@njit(cache=True, nogil=True)
def sample_room(reach: float) -> int:
    """How many samples :func:`edge_along` takes at most."""
    return 2 * int(np.ceil(reach / FINE)) + 5


@njit(cache=True, nogil=True, error_model="numpy")
def edge_along(
    gx: Floats32 | SignedShorts,
    gy: Floats32 | SignedShorts,
    line: tuple[float, float, float, float],
    reach: float,
    each: int,
    width: float,
    least: float,
    cos_least: float,
    room: Floats,
) -> tuple[float, float]:
    """The nearest good edge along one normal; see :func:`edge_search`.

    Args:
        gx: see there.
        gy: see there.
        line: u, v where it is expected [px], and the unit normal.
        reach: see there.
        each: samples a pixel, 1 or 2.
        width: see there.
        least: see there.
        cos_least: see there.
        room: (2, m) scratch for at least :func:`sample_room` samples.

    Returns:
        Its distance [px], NaN for none, and its gradient along the normal [levels/px].
    """
    if not sample_along(gx, gy, line, reach, each, room):
        return np.nan, 0.0
    return crest_of(room, reach, each, width, least, cos_least)


@njit(cache=True, nogil=True, error_model="numpy")
def sample_along(
    gx: Floats32 | SignedShorts,
    gy: Floats32 | SignedShorts,
    line: tuple[float, float, float, float],
    reach: float,
    each: int,
    out: Floats | Floats32,
) -> bool:
    """Gradients along one normal and across it, sample by sample; see :func:`edge_along`.

    Args:
        gx: see there.
        gy: see there.
        line: see there.
        reach: see there.
        each: see there.
        out: (2, m) gradients along the normal and across it, for :func:`crest_of`.

    Returns:
        Whether the picture shows all of it.
    """
    h, w = gx.shape
    u, v, nx, ny = line
    far = reach + 2.5
    if not (far < u < w - 1 - far and far < v < h - 1 - far):
        return False
    step = 1.0 / each
    half = int(np.ceil(reach * each))
    rise, aside = out[0], out[1]
    one, row, right = np.float32(1.0), np.uintp(w), np.uintp(1)
    xs, ys = gx.ravel(), gy.ravel()  # an index that cannot be negative is not tested for it
    for k in range(2 * half + 1 + 2 * each):
        d = (k - half - each) * step
        x, y = u + d * nx, v + d * ny
        x0, y0 = int(x), int(y)
        at = np.uintp(y0) * row + np.uintp(x0)
        fx, fy = np.float32(x - x0), np.float32(y - y0)
        w00, w01, w10, w11 = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
        a = w00 * xs[at] + w01 * xs[at + right]
        a += w10 * xs[at + row] + w11 * xs[at + row + right]
        b = w00 * ys[at] + w01 * ys[at + right]
        b += w10 * ys[at + row] + w11 * ys[at + row + right]
        rise[k] = a * nx + b * ny
        aside[k] = b * nx - a * ny
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def crest_of(
    samples: Floats | Floats32,
    reach: float,
    each: int,
    width: float,
    least: float,
    cos_least: float,
) -> tuple[float, float]:
    """The nearest good edge in what :func:`sample_along` took; see :func:`edge_along`."""
    step = 1.0 / each
    half = int(np.ceil(reach * each))
    rise, aside = samples[0], samples[1]
    best, offset, strength = 0.0, np.nan, 0.0
    for k in range(each, 2 * half + 1 + each):
        q = abs(rise[k])
        if q < least or q * q < cos_least * cos_least * (q * q + aside[k] * aside[k]):
            continue
        if q < abs(rise[k - 1]) or q <= abs(rise[k + 1]):
            continue
        d = (k - half - each) * step
        value = q * np.exp(-0.5 * (d / width) ** 2)
        if value > best:
            best = value
            # Samples a whole pixel apart are interpolated alike; half a pixel apart they are
            # not, and the crest would be drawn to the middle of a pixel.
            p, r = abs(rise[k - each]), abs(rise[k + each])
            bend = p - 2 * q + r
            offset = d + (0.5 * (p - r) / bend if bend < -1e-12 else 0.0)
            strength = rise[k]
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
