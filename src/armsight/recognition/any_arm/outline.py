"""Moves a fitted arm until its outline lies on that of the mask.

Landmarks are places that a network guesses inside of things; an outline is where things end, and is
seen to a fraction of a cell. Points of the fitted arm's outline are drawn to the nearest edge of
the mask, across it only (Drummond and Cipolla, PAMI 2002, with an edge map's distance instead of a
search), together with the landmarks, and again from there.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Floats, Floats32, Mask
from armsight.geometry.pose import transform
from armsight.recognition.any_arm.solver import Fit, Observations, again
from armsight.recognition.any_arm.views import Crop
from armsight.recognition.own_arm.surface import Rendered, arm_surface, render
from armsight.robots.kinematics import link_poses

GRID = 2
"""Pixels of the crop a pixel of what is drawn and compared."""
REACH = (0.10, 0.07, 0.05, 0.04)
"""Share of the crop from within which an edge draws, by rounds."""
SHARP = 1.3
"""Standard deviation of an edge of the mask [px of the crop]."""
ALIKE = 3
"""Neighbours on an outline err alike: one of so many is taken."""
ALONG = 30.0
"""Standard deviation along an edge, which tells nothing there [px of the crop]."""
ARM = 0.5
FEWEST = 12
SHARE = 0.2
"""Of the drawn arm in the mask."""
AGREES = 0.7
"""Overlap of a fit's outline with the mask from which it has a say in it."""


def follow_outline(
    fit: Fit, seen: Observations, arm: Floats32, crop: Crop, known: bool = False
) -> Fit:
    """The fit with its outline on the mask's; the fit itself where there is no edge to hold to.

    Args:
        fit: that explains the landmarks.
        seen: these.
        arm: (side, side) probability of the arm in the crop.
        crop: itself.
        known: keep the joints.
    """
    distance = edge_distance(arm)
    down, right = np.gradient(distance)
    slope = np.stack([down, right], -1)
    # Where the picture ends the mask does, too, and the arm does not.
    inside = within(crop, len(distance)).astype(np.uint8)
    away = cv2.erode(inside, np.ones((5, 5), np.uint8)) > 0
    best = fit
    for reach in REACH:
        pulls = _pulls(best, distance, slope, away, crop, reach * crop.side)
        if pulls is None:
            break
        best = again(best, _joined(seen, pulls), known)
    return best


def outline_overlap(fit: Fit, arm: Floats32, crop: Crop) -> float:
    """Intersection over union of a fitted arm, drawn small, with its (side, side) mask.

    Beyond the picture nobody knows.
    """
    drawn = _drawn(fit, crop, GRID).mask
    side = len(drawn)
    seen = cv2.resize(arm, (side, side), interpolation=cv2.INTER_AREA) > ARM
    inside = within(crop, side)
    either = (drawn | seen) & inside
    return float((drawn & seen & inside).sum() / max(either.sum(), 1))


def drawn_into(arm: Floats32, fit: Fit, overlap: float, crop: Crop) -> Floats32:
    """The mask with the fitted arm drawn into it, if that overlaps well enough to be believed.

    What the network is unsure about, kinematics decides; what it is sure about it keeps.

    Args:
        arm: (side, side) probability of the arm in the crop.
        fit: to it.
        overlap: of the fit's outline, 0..1.
        crop: itself.
    """
    if overlap < AGREES:
        return arm
    return np.asarray((1.0 - SHARE) * arm + SHARE * _drawn(fit, crop).mask, np.float32)


def _drawn(fit: Fit, crop: Crop, grid: int = 1) -> Rendered:
    """A fitted arm as a crop shows it, of which one pixel is ``grid`` pixels wide."""
    surface, side = arm_surface(fit.robot), crop.side // grid
    f, middle = crop.f / grid, 0.5 * (side - 1)
    lens = np.array([f, f, middle, middle, 0, 0, 0, 0, 0.0])
    return render(surface, surface.posed(fit.q), fit.T_camera_base, lens, (side, side))


def within(crop: Crop, side: int) -> Mask:
    """(side, side) where a crop lies within the picture."""
    small = cv2.resize(crop.inside.astype(np.uint8), (side, side), interpolation=cv2.INTER_NEAREST)
    return np.asarray(small > 0)


def edge_distance(arm: Floats32) -> Floats:
    """(n, n) signed distance to the mask's edge, above 0 outside [pixels of the grid]."""
    side = len(arm) // GRID
    small = cv2.resize(arm, (side, side), interpolation=cv2.INTER_AREA)
    inside = (small > ARM).astype(np.uint8)
    far = cv2.distanceTransform(1 - inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    deep = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.where(inside > 0, 0.5 - deep, far - 0.5), np.float64)


def _pulls(
    fit: Fit, distance: Floats, slope: Floats, away: Mask, crop: Crop, reach: float
) -> Observations | None:
    """Points of the outline and where on the mask's edge they should be."""
    drawn, f = _drawn(fit, crop, GRID), crop.f / GRID
    mask, side = drawn.mask, len(distance)
    rim = mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    # An outline at the crop's own edge is none.
    rim[[0, -1]], rim[:, [0, -1]] = False, False
    of_rim = rim[drawn.at[:, 0], drawn.at[:, 1]]
    drawn_at, owner, base = drawn.at[of_rim], drawn.owner[of_rim], drawn.points[of_rim]
    row, column = drawn_at[:, 0], drawn_at[:, 1]
    # A drawn pixel at the rim has its middle half a pixel within the edge.
    off = distance[row, column] + 0.5
    normal = slope[row, column]
    length = np.hypot(normal[:, 0], normal[:, 1])
    taken = (np.abs(off) * GRID < reach) & (length > 0.3)
    edge = drawn_at - off[:, None] * normal / np.maximum(length, 0.3)[:, None]
    edge = np.clip(np.round(edge).astype(int), 0, side - 1)
    taken &= away[row, column] & away[edge[:, 0], edge[:, 1]]
    if taken.sum() < FEWEST:
        return None
    taken[np.flatnonzero(taken)[np.arange(taken.sum()) % ALIKE > 0]] = False
    off, normal = off[taken], normal[taken] / length[taken, None]
    link, base = owner[taken], base[taken]
    T = link_poses(fit.robot, fit.q)[link]
    point = (np.swapaxes(T[:, :3, :3], 1, 2) @ (base - T[:, :3, 3])[:, :, None])[..., 0]
    now = transform(fit.T_camera_base, base)
    across = normal[:, ::-1]
    at = now[:, :2] / now[:, 2:] - off[:, None] * across / f
    along = np.stack([-across[:, 1], across[:, 0]], 1)
    wide, narrow = (ALONG / crop.f) ** 2, (SHARP / crop.f) ** 2
    covariance = narrow * across[:, :, None] * across[:, None] + wide * (
        along[:, :, None] * along[:, None]
    )
    return Observations(
        link.astype(np.int64),
        np.ascontiguousarray(point),
        np.ascontiguousarray(at),
        covariance,
        np.full(len(link), -1.0),
    )


def _joined(a: Observations, b: Observations) -> Observations:
    return Observations(*(np.concatenate([getattr(a, k), getattr(b, k)]) for k in vars(a)))
