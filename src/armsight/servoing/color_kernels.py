"""CIE Lab of pixels, compiled: only what is asked of it, in one pass over a picture.

OpenCV makes three planes of floats first, and its table of floats is off by up to 0.35.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, ColorImage, Floats, Floats32

CELLS = 8192
"""Of the table of cube roots: L*, a*, b* are exact to 1e-3."""


def _linear() -> Floats:
    """(256,) light of an 8-bit sRGB value (IEC 61966-2-1)."""
    v = np.arange(256) / 255.0
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def _roots() -> Floats:
    """(CELLS + 2,) CIE's f at the borders of the table's cells, from 0 to a little above 1."""
    t = np.arange(CELLS + 2) / CELLS
    return np.where(t > (6.0 / 29.0) ** 3, np.cbrt(t), t * (29.0 / 6.0) ** 2 / 3.0 + 4.0 / 29.0)


LINEAR, ROOTS = _linear(), _roots()
_X = np.array([0.412453, 0.357580, 0.180423]) / 0.950456
_Y = np.array([0.212671, 0.715160, 0.072169])
_Z = np.array([0.019334, 0.119193, 0.950227]) / 1.088754


@njit(cache=True, nogil=True, inline="always")
def _root(t: float) -> float:
    at = min(t, 1.0) * CELLS
    k = int(at)
    return ROOTS[k] + (at - k) * (ROOTS[k + 1] - ROOTS[k])


@njit(cache=True, nogil=True, inline="always")
def _lab(r: int, g: int, b: int) -> tuple[float, float, float]:
    """L* (0..100), a*, b* of an sRGB pixel, white as D65."""
    red, green, blue = LINEAR[r], LINEAR[g], LINEAR[b]
    x = _root(_X[0] * red + _X[1] * green + _X[2] * blue)
    y = _root(_Y[0] * red + _Y[1] * green + _Y[2] * blue)
    z = _root(_Z[0] * red + _Z[1] * green + _Z[2] * blue)
    return 116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)


@njit(cache=True, nogil=True)
def chroma_along(image: ColorImage, hue: Floats, out: Floats32) -> None:
    """Write the part of (a*, b*) along a hue.

    Args:
        image: (h, w, 3) sRGB.
        hue: (2,) its cosine and sine.
        out: (h, w).
    """
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            _, a, b = _lab(image[v, u, 0], image[v, u, 1], image[v, u, 2])
            out[v, u] = a * hue[0] + b * hue[1]


@njit(cache=True, nogil=True)
def pick_color(
    image: ColorImage,
    quick: Bytes,
    brightest: Bytes,
    hue: Floats,
    wide: float,
    chroma: float,
    purity: float,
    lightness: tuple[float, float],
    out: Bytes,
) -> None:
    """Write 255 where a picture has a colour, else 0.

    Args:
        image: (h, w, 3) sRGB.
        quick: (h, w, 3) its 8-bit CIE Lab, as OpenCV has it.
        brightest: (256, 256) 8-bit lightness by a and b below which a pixel may have the colour.
        hue: (2,) its cosine and sine.
        wide: tangent of how far the hue may be off.
        chroma: least length along the hue.
        purity: least share of it in L*.
        lightness: least and greatest L*.
        out: (h, w).
    """
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            out[v, u] = 0
            if quick[v, u, 0] >= brightest[quick[v, u, 1], quick[v, u, 2]]:
                continue
            light, a, b = _lab(image[v, u, 0], image[v, u, 1], image[v, u, 2])
            along, across = a * hue[0] + b * hue[1], abs(b * hue[0] - a * hue[1])
            fits = along > chroma and along > purity * light and across < along * wide
            if fits and lightness[0] < light < lightness[1]:
                out[v, u] = 255
