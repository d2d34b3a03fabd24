"""From a map of where a landmark may be to a place with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Floats32

WINDOW = 4
"""Cells about the highest one that are averaged, either way."""
GRAIN = 0.08
"""Variance [cells^2] that a place has at least: the grid's own."""


@dataclass(frozen=True)
class Places:
    """Landmarks in the map's cells.

    Attributes:
        mean: (p, 2) column, row of the middle of the highest peak.
        covariance: (p, 2, 2) of that peak, widened by what lies outside of it.
        mass: (p,) probability of the peak: that the landmark is in the map, and there.
    """

    mean: Floats
    covariance: Floats
    mass: Floats


def read_heat(heat: Floats32, outside: Floats32) -> Places:
    """Places of p landmarks.

    Args:
        heat: (p, h, w) logits.
        outside: (p,) logit of not being in the map, of the same softmax.
    """
    p, h, w = heat.shape
    flat = heat.reshape(p, -1).astype(np.float64)
    top = np.maximum(flat.max(axis=1), outside)
    weight = np.exp(flat - top[:, None])
    weight /= (weight.sum(axis=1) + np.exp(outside - top))[:, None]
    peak = flat.argmax(axis=1)
    row, column = peak // w, peak % w
    y, x = np.arange(h), np.arange(w)
    near_y = np.abs(y[None] - row[:, None]) <= WINDOW
    near_x = np.abs(x[None] - column[:, None]) <= WINDOW
    inside = weight.reshape(p, h, w) * near_y[:, :, None] * near_x[:, None, :]
    mass = np.maximum(inside.sum(axis=(1, 2)), 1e-12)
    share = inside / mass[:, None, None]
    mean = np.stack([(share.sum(1) * x).sum(1), (share.sum(2) * y).sum(1)], 1)
    dx, dy = x[None] - mean[:, :1], y[None] - mean[:, 1:]
    covariance = np.empty((p, 2, 2))
    covariance[:, 0, 0] = (share.sum(1) * dx**2).sum(1)
    covariance[:, 1, 1] = (share.sum(2) * dy**2).sum(1)
    covariance[:, 0, 1] = covariance[:, 1, 0] = np.einsum("pyx,py,px->p", share, dy, dx)
    covariance /= np.clip(mass, 0.05, 1.0)[:, None, None] ** 2
    covariance += GRAIN * np.eye(2)
    return Places(mean, covariance, mass)
