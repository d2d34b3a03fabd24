"""Finding a sphere of known radius in a depth picture, near where the arm holds it.

Each pixel votes for the point one radius behind its surface; on a sphere all votes meet. So nothing
but the shape is asked for: no colour, no empty room, no background taken away.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import DepthImage, Floats, Mask, Points, Vector3
from armsight.calibration.spheres import SphereFit, fit_sphere
from armsight.devices.data import DepthNoise
from armsight.geometry.camera import PinholeCamera

STEP = 2
"""Normals are taken from neighbours this far away [px]."""
VOTES = 400
"""Votes that are tried as the centre."""
TOGETHER = 0.3
"""Votes within this share of the radius are for the same centre."""
INNER = 0.85
"""Of the visible disc: further out, surface and background mix in a pixel."""
LEAST_SHARE = 0.45
"""Of the visible disc that must be there: what is hidden further has a doubtful centre."""
RADIUS_SHARE = 0.25
"""The radius that the cap itself tells may be off by this share."""
ROUGH = 0.06
"""A cap rougher than this share of the radius, or than thrice the noise, is no sphere."""


def find_sphere(
    depth: DepthImage,
    lens: PinholeCamera,
    noise: DepthNoise,
    radius: float,
    near: Vector3,
    within: float,
) -> SphereFit | None:
    """The sphere near a place, in the lens's frame; None where there is none to be believed.

    Args:
        depth: (h, w) [m], NaN without a return; several exposures averaged.
        lens: of the picture.
        noise: of one exposure.
        radius: of the sphere [m].
        near: (3,) where its centre is expected [m].
        within: how far from there it may be [m].
    """
    near = np.asarray(near, float)
    if near[2] <= radius:
        return None
    window = _window(lens, radius, near, within)
    if window is None:
        return None
    rows, columns = window
    z = np.asarray(depth[rows, columns], float)
    points = np.concatenate([lens.rays[rows, columns] * z[..., None], z[..., None]], axis=2)
    votes = _votes(points, radius)
    votes = votes[np.linalg.norm(votes - near, axis=1) < within]
    if len(votes) < 12:
        return None
    center = _most_voted(votes, TOGETHER * radius)
    known = points[np.isfinite(z)]
    for _ in range(2):
        fit = fit_sphere(known[_on_cap(known, center, radius)], radius)
        if fit is None:
            return None
        center = fit.center
    cap = known[_on_cap(known, center, radius)]
    fit = fit_sphere(cap, radius)
    if fit is None or np.linalg.norm(fit.center - near) > within:
        return None
    visible = np.pi * (INNER * radius * 0.5 * (lens.fx + lens.fy) / fit.center[2]) ** 2
    sigma = float(noise.sigma(fit.center[2]))
    if fit.points < LEAST_SHARE * visible or fit.rms > max(ROUGH * radius, 3.0 * sigma):
        return None
    if abs(_free_radius(cap) / radius - 1.0) > RADIUS_SHARE:
        return None
    return fit


def _free_radius(points: Points) -> float:
    """Radius of the sphere through points by linear least squares [m]; NaN without one."""
    middle = points.mean(0)
    p = points - middle
    A = np.column_stack([2.0 * p, np.ones(len(p))])
    x = np.linalg.lstsq(A, np.sum(p * p, axis=1), rcond=None)[0]
    return float(np.sqrt(max(x[3] + x[:3] @ x[:3], 0.0)))


def _window(
    lens: PinholeCamera, radius: float, near: Vector3, within: float
) -> tuple[slice, slice] | None:
    """Rows and columns in which a sphere may be; None outside of the picture."""
    reach = (radius + within) / max(near[2] - within, radius)
    u, v = lens.project(near[None])[0]
    low_u, high_u = int(u - reach * lens.fx) - STEP, int(u + reach * lens.fx) + STEP + 2
    low_v, high_v = int(v - reach * lens.fy) - STEP, int(v + reach * lens.fy) + STEP + 2
    low_u, high_u = max(low_u, 0), min(high_u, lens.width)
    low_v, high_v = max(low_v, 0), min(high_v, lens.height)
    if high_u - low_u < 4 * STEP or high_v - low_v < 4 * STEP:
        return None
    return slice(low_v, high_v), slice(low_u, high_u)


def _votes(points: Floats, radius: float) -> Points:
    """(m, 3) the centres for which the pixels of (h, w, 3) points vote."""
    smooth = np.stack([cv2.blur(points[..., k], (3, 3)) for k in range(3)], axis=2)
    s = STEP
    across = smooth[s:-s, 2 * s :] - smooth[s:-s, : -2 * s]
    down = smooth[2 * s :, s:-s] - smooth[: -2 * s, s:-s]
    normal = np.cross(across, down)
    length = np.linalg.norm(normal, axis=2)
    middle = smooth[s:-s, s:-s]
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / length[..., None]
        # Behind the surface, seen from the lens.
        normal = normal * np.sign(np.sum(normal * middle, axis=2))[..., None]
        steep = np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2])) > radius
    good = np.isfinite(normal).all(2) & ~steep
    return np.asarray((middle + radius * normal)[good])


def _most_voted(votes: Points, together: float) -> Vector3:
    """The middle of the votes about the one with the most others near it."""
    tried = votes[:: max(1, len(votes) // VOTES)]
    best, most = tried[0], -1
    for one in tried:
        near = np.sum((votes - one) ** 2, axis=1) < together**2
        count = int(near.sum())
        if count > most:
            best, most = votes[near].mean(axis=0), count
    return np.asarray(best, float)


def _on_cap(points: Points, center: Vector3, radius: float) -> Mask:
    """(m,) which points are on the visible cap of a sphere about there, its rim left out."""
    away = points - center
    axis = center / np.linalg.norm(center)
    along = away @ axis
    aside = np.linalg.norm(away - along[:, None] * axis, axis=1)
    off = np.abs(np.linalg.norm(away, axis=1) - radius)
    return np.asarray((along < 0.0) & (aside < INNER * radius) & (off < 0.3 * radius), bool)
