"""The centre of a sphere of known radius from its outlines and its surface, whatever lenses saw it.

The rays from a lens to the outline touch the sphere: they form its tangent cone, whose axis goes
through the centre and whose half angle is asin(R / distance). So an outline needs no correction of
an ellipse's centre, and one lens alone already knows the distance; a second lens and points on the
surface (their mean lies 2/3 R before the centre) come in as more residuals of one least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from armsight.arrays import Floats, Ints, Points, Vector3

ROUNDS = 12
TRIES = 96
"""Triples of rays that are tried for a cone."""


@dataclass(frozen=True)
class Outline:
    """Rays of one lens to a sphere's outline.

    Attributes:
        origin: (3,) the lens [m].
        rays: (k, 3) unit vectors in the same frame.
        sigma: of a ray [rad].
    """

    origin: Vector3
    rays: Points
    sigma: float


@dataclass(frozen=True)
class BallFit:
    """A fitted sphere.

    Attributes:
        center: (3,) [m].
        covariance: (3, 3) [m^2].
        misfit: rms of the residuals in units of their standard deviations.
        share: of the residuals within three standard deviations.
    """

    center: Vector3
    covariance: Floats
    misfit: float
    share: float


@dataclass(frozen=True)
class Cone:
    """The tangent cone of a sphere.

    Attributes:
        axis: (3,) unit; half: half angle [rad].
        rays: (m, 3) those that lie on it.
    """

    axis: Vector3
    half: float
    rays: Points


def tangent_cone(rays: Points, sigma: float) -> Cone | None:
    """The cone that most of (k, 3) unit rays lie on.

    The rays of a cone obey u . w = 1 with w = axis / cos(half angle), so three of them make one;
    that of the most followers is taken, then least squares of those. What hides a part of the
    outline puts rays elsewhere, and they have no say. None with fewer than eight rays or followers.
    """
    if len(rays) < 8:
        return None
    triples = rays[_triples(len(rays))]
    good = np.abs(np.linalg.det(triples)) > 1e-12
    if not good.any():
        return None
    w = np.linalg.solve(triples[good], np.ones((int(good.sum()), 3, 1)))[..., 0]
    length = np.linalg.norm(w, axis=1)
    w, length = w[length > 1.0], length[length > 1.0]
    if not len(w):
        return None
    near = np.abs(_angles(rays, w / length[:, None]) - np.arccos(1.0 / length)) < 3.0 * sigma
    keep = near[:, int(np.argmax(near.sum(axis=0)))]
    axis, half = rays.mean(axis=0), 0.0
    for _ in range(5):
        if keep.sum() < 8:
            return None
        v = np.linalg.lstsq(rays[keep], np.ones(int(keep.sum())), rcond=None)[0]
        size = float(np.linalg.norm(v))
        if not np.isfinite(size) or size <= 1.0:
            return None
        axis, half = np.asarray(v / size, float), float(np.arccos(1.0 / size))
        off = np.abs(_angles(rays, axis[None])[:, 0] - half)
        now = off < 3.0 * max(1.48 * float(np.median(off[keep])), sigma)
        if np.array_equal(now, keep):
            break
        keep = now
    return Cone(axis, half, rays[keep])


def _angles(rays: Points, axes: Points) -> Floats:
    """(k, m) angles between (k, 3) rays and (m, 3) axes [rad]; exact for small ones, too."""
    x, y, z = (rays[:, None, i] - axes[None, :, i] for i in range(3))
    half_chord = 0.5 * np.sqrt(x * x + y * y + z * z)
    return np.asarray(2.0 * np.arcsin(np.minimum(half_chord, 1.0)))


@cache
def _triples(count: int) -> Ints:
    """(m, 3) different indices, spread; the same every time."""
    rng = np.random.default_rng(count)
    return np.argsort(rng.random((TRIES, count)), axis=1)[:, :3]


def fit_ball(
    radius: float,
    start: Vector3,
    outlines: Sequence[Outline] = (),
    surface: Points | None = None,
    surface_sigma: float = 0.003,
) -> BallFit | None:
    """Gauss-Newton with Huber weights on outlines and surface points; None where it goes astray.

    Args:
        radius: of the sphere [m].
        start: (3,) about where its centre is [m].
        outlines: of each lens.
        surface: (k, 3) points on it, in the same frame [m].
        surface_sigma: of a surface point along its ray [m].
    """
    center = np.array(start, float)
    H, r = np.eye(3), np.zeros(0)
    for _ in range(ROUNDS):
        rows, residuals = [], []
        for seen in outlines:
            to = center - seen.origin
            along = seen.rays @ to
            across = to - along[:, None] * seen.rays
            length = np.linalg.norm(across, axis=1)
            scale = 1.0 / (seen.sigma * max(float(np.linalg.norm(to)), 1e-6))
            rows.append(scale * across / np.maximum(length, 1e-9)[:, None])
            residuals.append(scale * (length - radius))
        if surface is not None and len(surface):
            to = center - surface
            length = np.linalg.norm(to, axis=1)
            rows.append(to / np.maximum(length, 1e-9)[:, None] / surface_sigma)
            residuals.append((length - radius) / surface_sigma)
        if not rows:
            return None
        J, r = np.concatenate(rows), np.concatenate(residuals)
        # Far from the answer everything is off: what counts is what is off more than the rest.
        knee = max(2.0, 2.0 * float(np.median(np.abs(r))))
        weight = np.minimum(1.0, knee / np.maximum(np.abs(r), 1e-9))
        H = (J * weight[:, None]).T @ J + 1e-6 * np.eye(3)
        step = -np.linalg.solve(H, (J * weight[:, None]).T @ r)
        center = center + step
        if not np.isfinite(center).all() or np.linalg.norm(center - start) > 8.0 * radius:
            return None
        if np.linalg.norm(step) < 1e-8:
            break
    good = np.abs(r) < 3.0
    if good.sum() < 8:
        return None
    misfit = float(np.sqrt(np.mean(r[good] ** 2)))
    covariance = np.asarray(np.linalg.inv(H), float) * max(1.0, misfit) ** 2
    return BallFit(center, covariance, misfit, float(good.mean()))
