"""Where circles of known radius lie, from their outlines and the depth inside, whatever lenses saw.

A printed circle seen aslant is an ellipse whose centre is not the circle's (V neglects that). Here
the rays to the outline are compared with the circle itself, in space: five numbers, its centre and
its normal, by least squares over the outlines of all lenses, of all concentric circles of the
print, and of the depth points on its plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Points, Vector3
from armsight.geometry.pose import unit
from armsight.servoing.kernels import disc_residuals
from armsight.servoing.sphere_fit import Outline

ROUNDS = 15
STEP = 1e-6
"""Of the derivatives [m], [rad]."""


@dataclass(frozen=True)
class Circle:
    """The outline of one printed circle of a radius [m], in one lens."""

    outline: Outline
    radius: float


@dataclass(frozen=True)
class DiscFit:
    """Fitted concentric circles.

    Attributes:
        center: (3,) [m]; normal: (3,) unit, towards who looks.
        covariance: (3, 3) of the centre [m^2].
        misfit: rms of the residuals in units of their standard deviations; share: of the
            outlines' residuals within three of them.
        tilt: standard deviation of the normal, along its worst axis [rad].
    """

    center: Vector3
    normal: Vector3
    covariance: Floats
    misfit: float
    share: float
    tilt: float


def fit_disc(
    start: Vector3,
    normal: Vector3,
    circles: Sequence[Circle],
    surface: Points | None = None,
    surface_sigma: float = 0.003,
) -> DiscFit | None:
    """Gauss-Newton with Huber weights; None where it goes astray.

    Args:
        start: (3,) about where the centre is [m].
        normal: (3,) about the normal, towards the lens.
        circles: of each lens and radius.
        surface: (k, 3) points on the plane [m].
        surface_sigma: of one of them, along the normal [m].
    """
    center, z = np.array(start, float), unit(normal)
    outer = max((c.radius for c in circles), default=0.0)
    if not circles:
        return None
    points = np.empty((0, 3)) if surface is None else np.asarray(surface, float)
    residuals = _residuals(circles, points, surface_sigma)
    edges = sum(len(c.outline.rays) for c in circles)
    H, r = np.eye(5), np.zeros(0)
    for _ in range(ROUNDS):
        x, y = across(z)
        r = residuals(center, z)
        J = np.empty((len(r), 5))
        for k in range(3):
            J[:, k] = (residuals(center + STEP * np.eye(3)[k], z) - r) / STEP
        for k, axis in enumerate((x, y)):
            J[:, 3 + k] = (residuals(center, unit(z + STEP * axis)) - r) / STEP
        if not np.isfinite(J).all():
            return None
        knee = max(2.0, 2.0 * float(np.median(np.abs(r))))
        weight = np.minimum(1.0, knee / np.maximum(np.abs(r), 1e-9))
        H = (J * weight[:, None]).T @ J + np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4])
        step = -np.linalg.solve(H, (J * weight[:, None]).T @ r)
        turn = float(np.linalg.norm(step[3:]))
        step[3:] *= min(1.0, 0.3 / max(turn, 1e-9))
        center = center + step[:3]
        z = unit(z + step[3] * x + step[4] * y)
        if not np.isfinite(center).all() or np.linalg.norm(center - start) > 4.0 * outer:
            return None
        if np.linalg.norm(step) < 1e-8:
            break
    good = np.abs(r) < 3.0
    if good[:edges].sum() < 8:
        return None
    misfit = float(np.sqrt(np.mean(r[good] ** 2)))
    C = np.asarray(np.linalg.inv(H), float) * max(1.0, misfit) ** 2
    tilt = float(np.sqrt(np.linalg.eigvalsh(C[3:, 3:])[-1]))
    if z @ (circles[0].outline.origin - center) < 0.0:
        z = -z
    return DiscFit(center, z, C[:3, :3], misfit, float(good[:edges].mean()), tilt)


def plane_of(points: Points, towards: Vector3) -> tuple[Vector3, Vector3]:
    """Middle (3,) [m] and unit normal (3,) of points on a plane, some of which are not.

    Args:
        points: (k, 3), at least 4 [m].
        towards: (3,) the side to which the normal points [m].
    """
    kept = points
    middle, normal = points.mean(axis=0), np.array([0.0, 0.0, 1.0])
    for _ in range(4):
        middle = np.median(kept, axis=0)
        normal = np.linalg.svd(kept - middle, full_matrices=False)[2][2]
        off = np.abs((points - middle) @ normal)
        kept = points[off <= max(2.5 * float(np.median(off)), 1e-4)]
        if len(kept) < 4:
            break
    if normal @ (towards - middle) < 0.0:
        normal = -normal
    return middle, np.asarray(normal, float)


def meet(origin: Vector3, rays: Points, point: Vector3, normal: Vector3) -> Points:
    """(k, 3) where rays (k, 3) from a lens meet a plane [m]."""
    along = ((point - origin) @ normal) / (rays @ normal)
    return np.asarray(origin + along[:, None] * rays)


def _residuals(
    circles: Sequence[Circle], points: Points, sigma: float
) -> Callable[[Vector3, Vector3], Floats]:
    """What gives the (n,) residuals at a centre (3,) and a normal (3,)."""
    outlines = [(circle.outline, circle.radius) for circle in circles]
    rays = np.concatenate([seen.rays for seen, _ in outlines])
    count = [len(seen.rays) for seen, _ in outlines]
    origin = np.repeat(np.array([seen.origin for seen, _ in outlines], float), count, axis=0)
    radius = np.repeat([radius for _, radius in outlines], count)
    sigmas = np.repeat([seen.sigma for seen, _ in outlines], count)
    surface = np.ascontiguousarray(points, float)

    def at(center: Vector3, normal: Vector3) -> Floats:
        out = np.empty(len(rays) + len(surface))
        disc_residuals(center, normal, origin, rays, radius, sigmas, surface, sigma, out)
        return out

    return at


def across(z: Vector3) -> tuple[Vector3, Vector3]:
    """Two unit vectors across a direction."""
    k = int(np.argmin(np.abs(z)))
    i, j = (k + 1) % 3, (k + 2) % 3
    x = np.zeros(3)
    x[i], x[j] = -z[j], z[i]  # e_k cross z
    x /= math.hypot(z[i], z[j])
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return x, y
