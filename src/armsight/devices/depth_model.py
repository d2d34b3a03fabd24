"""How a depth camera's readings differ from the truth, and how to undo it.

The error is an offset, a scale, a smooth curve over depth for the wiggle of time-of-flight cameras,
and a low-order surface over the image. ``calibration/depth.py`` fits it; the map undoes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import DepthImage, Floats, Floats32
from armsight.geometry.camera import PinholeCamera

TABLE_STEP, TABLE_END = 0.001, 12.0
"""Measured depths for which the true one is tabled: spacing and end [m]."""


@dataclass(frozen=True, eq=False)
class DepthModel:
    """Measured depth = true depth + error(true depth, place in the image).

    Attributes:
        offset: [m]; scale: [1] at ``middle``.
        knots: (k,) depths [m] and values: (k,) of the spline there [m], natural and smooth.
        surface: (3,) coefficients of u, v and r squared over half the image [m].
        middle: depth about which the scale turns [m].
        range: depths that the data cover [m].
        rms: residual over frames [m].
        scale_known: the data cover more than one distance.
    """

    offset: float
    scale: float
    knots: Floats
    values: Floats
    surface: Floats
    middle: float
    range: tuple[float, float]
    rms: float
    scale_known: bool

    def error(self, true: Floats, pixel: Floats, lens: PinholeCamera) -> Floats:
        """(m,) error [m] at true depths [m] and pixels."""
        return np.asarray(self.along(true) + surface_terms(pixel, lens) @ self.surface)

    def along(self, true: Floats) -> Floats:
        """The part of the error that depends on depth alone [m]."""
        z = np.asarray(true, float)
        out = self.offset + self.scale * (z - self.middle)
        if len(self.knots):
            out = out + spline_basis(np.clip(z, *self.range), self.knots) @ self.values
        return np.asarray(out)

    def corrected(self, depth: DepthImage, lens: PinholeCamera) -> DepthImage:
        """A depth image with the error taken away; NaN stays NaN."""
        return DepthCorrection(self, lens).apply(depth)


class DepthCorrection:
    """A depth model made ready to correct image after image of one lens.

    The error is a function of depth plus one of the place in the image, so a table over depth, read
    after the place's share has been taken away, undoes it exactly.
    """

    def __init__(self, model: DepthModel, lens: PinholeCamera) -> None:
        v, u = np.mgrid[0 : lens.height, 0 : lens.width].astype(float)
        pixel = np.stack([u.ravel(), v.ravel()], 1)
        surface = surface_terms(pixel, lens) @ model.surface
        self.surface: Floats32 = surface.reshape(lens.height, lens.width).astype(np.float32)
        true = np.arange(0.0, TABLE_END, TABLE_STEP)
        # A sane model is monotonic; a table of a steeper one must be as well to be read backwards.
        measured = np.maximum.accumulate(true + model.along(true))
        self.first = float(measured[0])
        at = np.arange(measured[0], measured[-1], TABLE_STEP)
        self.true: Floats32 = np.interp(at, measured, true).astype(np.float32)

    def apply(self, depth: DepthImage) -> DepthImage:
        """(h, w) corrected depth [m]; NaN stays NaN."""
        index = (depth - self.surface - np.float32(self.first)) * np.float32(1.0 / TABLE_STEP)
        known = np.isfinite(index)
        index = np.clip(np.where(known, index, 0.0), 0.0, len(self.true) - 1.001)
        low = index.astype(np.int32)
        share = index - low
        true = self.true[low] * (1.0 - share) + self.true[low + 1] * share
        return np.where(known, true, np.float32(np.nan)).astype(np.float32)


def surface_terms(pixel: Floats, lens: PinholeCamera) -> Floats:
    """(m, 3) u, v and r squared of pixels over half the image, of which a surface is made."""
    u = (pixel[:, 0] - 0.5 * (lens.width - 1)) / (0.5 * lens.width)
    v = (pixel[:, 1] - 0.5 * (lens.height - 1)) / (0.5 * lens.height)
    r2 = 0.5 * (u * u + v * v)
    return np.stack([u, v, r2 - 0.25], axis=1)


def spline_basis(z: Floats, knots: Floats) -> Floats:
    """(m, k) cubic B-spline-like bumps: Gaussians of the knots' spacing, smooth and local."""
    spacing = knots[1] - knots[0] if len(knots) > 1 else 1.0
    return np.asarray(np.exp(-0.5 * ((z[:, None] - knots) / (0.7 * spacing)) ** 2))
