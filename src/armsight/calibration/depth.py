"""Depth models fitted: how a depth camera's readings differ from the truth.

A flat board of known place gives the true depth along every ray. The error is modelled as an
offset, a scale, a spline in z for the wiggle of time-of-flight cameras, and a low-order surface
over the image. Ten thousand pixels of one frame are not independent: each frame
has an error of its own, so the frame, not the pixel, is what counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import DepthImage, Floats
from armsight.devices.depth_model import DepthModel, spline_basis, surface_terms
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class DepthSamples:
    """Depth read on a board in one view.

    Attributes:
        pixel: (m, 2) where [px]; measured: (m,) median depth about there [m].
        true: (m,) depth of the board's plane there [m].
        sigma: (m,) random error of a reading [m].
    """

    pixel: Floats
    measured: Floats
    true: Floats
    sigma: Floats


def fit_depth(
    samples: list[DepthSamples],
    lens: PinholeCamera,
    spacing: float = 0.15,
    frame_sigma: float = 0.001,
    wiggle_sigma: float = 0.004,
) -> DepthModel | None:
    """Fit a depth model; None with no sample at all.

    Args:
        samples: one a view.
        lens: of the depth image.
        spacing: of the spline's knots [m].
        frame_sigma: error common to a frame [m].
        wiggle_sigma: prior size of the spline and of the surface [m].
    """
    samples = [s for s in samples if len(s.measured)]
    if not samples:
        return None
    frame = np.concatenate([np.full(len(s.measured), k) for k, s in enumerate(samples)])
    pixel = np.concatenate([s.pixel for s in samples])
    z = np.concatenate([s.true for s in samples])
    y = np.concatenate([s.measured for s in samples]) - z
    sigma = np.maximum(np.concatenate([s.sigma for s in samples]), 3e-4)
    low, high = float(np.quantile(z, 0.01)), float(np.quantile(z, 0.99))
    middle = 0.5 * (low + high)
    known = high - low > 0.15
    knots = (
        np.arange(low, high + 0.5 * spacing, spacing) if high - low > 2 * spacing else np.zeros(0)
    )
    columns = [np.ones_like(z), z - middle if known else np.zeros_like(z)]
    curve = spline_basis(z, knots) if len(knots) else np.zeros((len(z), 0))
    A = np.column_stack([*columns, curve, surface_terms(pixel, lens)])
    n = A.shape[1]
    # The offset is free; the scale is of the order of a percent, the rest of millimetres.
    prior = np.full(n, wiggle_sigma)
    prior[0], prior[1] = 1.0, 0.02
    frames = np.eye(len(samples))[frame]
    full = np.hstack([A, frames])
    information = np.diag(np.concatenate([1 / prior**2, np.full(len(samples), 1 / frame_sigma**2)]))
    weight = np.ones_like(y)
    x = np.zeros(full.shape[1])
    for _ in range(6):  # Huber: edges and flying pixels
        w = weight / sigma**2
        x = np.linalg.solve(full.T @ (full * w[:, None]) + information, full.T @ (w * y))
        r = np.abs(y - full @ x) / sigma
        weight = np.minimum(1.0, 3.0 / np.maximum(r, 1e-12))
    k = len(knots)
    means = [float(np.mean((y - A @ x[:n])[frame == f])) for f in range(len(samples))]
    return DepthModel(
        float(x[0]),
        float(x[1]),
        knots,
        x[2 : 2 + k],
        x[2 + k : n],
        middle,
        (low, high),
        float(np.sqrt(np.mean(np.square(means)))),
        known,
    )


def read_squares(
    depth: DepthImage, grid: Floats, white: Floats, scale: float = 1.0, erode: float = 3.0
) -> tuple[Floats, Floats]:
    """Median depth on the white squares of a checkerboard.

    Args:
        depth: the image [m].
        grid: (rows, columns, 2) corners in the picture that the corners were found in [px].
        white: (rows - 1, columns - 1) which squares are white.
        scale: picture pixels a depth pixel.
        erode: kept away from the squares' edges [px of the depth image].

    Returns:
        (m, 2) centres [px of the depth image], (m,) depth [m].
    """
    centres, values = [], []
    for j in range(grid.shape[0] - 1):
        for i in range(grid.shape[1] - 1):
            if not white[j, i]:
                continue
            corners = (grid[j : j + 2, i : i + 2].reshape(4, 2) + 0.5) / scale - 0.5
            if not np.isfinite(corners).all():
                continue
            c = corners.mean(0)
            half = 0.5 * min(
                np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[2] - corners[0])
            )
            reach = max(0.7 * half - 0.5 * erode, 1.0)
            u0, v0 = np.maximum(np.ceil(c - reach), 0).astype(int)
            u1, v1 = np.floor(c + reach).astype(int) + 1
            window = depth[v0:v1, u0:u1]
            good = window[np.isfinite(window)]
            if len(good) < 3:
                continue
            centres.append([0.5 * (u0 + u1 - 1), 0.5 * (v0 + v1 - 1)])
            values.append(float(np.median(good)))
    return np.array(centres).reshape(-1, 2), np.array(values)


def plane_depth(T_lens_board: Floats, pixel: Floats, lens: PinholeCamera) -> Floats:
    """(m,) depth along the optical axis where pixels' rays meet a board's plane [m]."""
    ray = np.column_stack([lens.normalise(pixel), np.ones(len(pixel))])
    n, p = T_lens_board[:3, 2], T_lens_board[:3, 3]
    return np.asarray((n @ p) / (ray @ n))
