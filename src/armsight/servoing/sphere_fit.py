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
from armsight.servoing.sphere_kernels import fitted_sphere, followed_cone

ROUNDS = 12
TRIES = 96
"""Triples of rays that are tried for a cone."""
NOTHING = np.empty((0, 3))


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
    axis, keep = np.empty(3), np.empty(len(rays), np.bool_)
    half = followed_cone(np.ascontiguousarray(rays), _triples(len(rays)), sigma, axis, keep)
    return Cone(axis, float(half), rays[keep]) if half >= 0.0 else None


@cache
def _triples(count: int) -> Ints:
    """(m, 3) different indices, spread; the same every time."""
    rng = np.random.default_rng(count)
    return np.ascontiguousarray(np.argsort(rng.random((TRIES, count)), axis=1)[:, :3])


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
    points = NOTHING if surface is None else np.ascontiguousarray(surface, float)
    if not outlines and len(points) == 0:
        return None
    counts = [len(seen.rays) for seen in outlines]
    rays = np.concatenate([NOTHING, *(seen.rays for seen in outlines)])
    origins = np.concatenate([NOTHING, *(np.tile(s.origin, (len(s.rays), 1)) for s in outlines)])
    sigmas = np.repeat([seen.sigma for seen in outlines], counts).astype(float)
    center, H, r = np.empty(3), np.empty((3, 3)), np.empty(len(rays) + len(points))
    if not fitted_sphere(
        float(radius), np.asarray(start, float), origins, rays, sigmas, points,
        float(surface_sigma), ROUNDS, center, H, r,
    ):  # fmt: skip
        return None
    good = np.abs(r) < 3.0
    if good.sum() < 8:
        return None
    misfit = float(np.sqrt(np.mean(r[good] ** 2)))
    covariance = np.asarray(np.linalg.inv(H), float) * max(1.0, misfit) ** 2
    return BallFit(center, covariance, misfit, float(good.mean()))
