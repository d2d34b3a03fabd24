"""Moves a fitted arm until its outline lies on that of the mask.

Landmarks are places that a network guesses inside of things; an outline is where things end, and is
seen to a fraction of a cell. Points of the fitted arm's outline are drawn to the nearest edge of
the mask, across it only (Drummond and Cipolla, PAMI 2002, with an edge map's distance instead of a
search), together with the landmarks, and again from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import DepthImage, Floats, Floats32, Ints, Ints32, Mask, Poses
from armsight.recognition.any_arm.pixel_kernels import rim_pulls
from armsight.recognition.any_arm.solver import Fit, Observations, again
from armsight.recognition.any_arm.views import Crop
from armsight.recognition.own_arm.surface import arm_surface, drawn
from armsight.robots.kernels import carried_points
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


@dataclass(frozen=True)
class Edge:
    """Of a mask in a crop, on a grid of :data:`GRID` pixels.

    Attributes:
        crop: the mask is in.
        mask: (n, n) itself; inside: (n, n) where the crop lies within the picture.
        distance: (n, n) signed distance to its edge, above 0 outside [pixels of the grid].
        away: (n, n) where the picture's own edge is far: there the mask ends, and the arm does not.
    """

    crop: Crop
    mask: Mask
    inside: Mask
    distance: Floats
    away: Mask

    @classmethod
    def of(cls, arm: Floats32, crop: Crop) -> Edge:
        """Of a (side, side) probability of the arm."""
        side = len(arm) // GRID
        mask = cv2.resize(arm, (side, side), interpolation=cv2.INTER_AREA) > ARM
        seen = mask.astype(np.uint8)
        far = cv2.distanceTransform(1 - seen, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        deep = cv2.distanceTransform(seen, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside = within(crop, side)
        away = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        distance = np.where(mask, 0.5 - deep, far - 0.5).astype(np.float64)
        return cls(crop, np.asarray(mask), inside, distance, np.asarray(away))


def follow_outline(fit: Fit, seen: Observations, edge: Edge, known: bool = False) -> Fit:
    """The fit with its outline on the mask's; the fit itself where there is no edge to hold to.

    Args:
        fit: that explains the landmarks.
        seen: these.
        edge: of the mask.
        known: keep the joints.
    """
    best = fit
    for reach in REACH:
        pulls = _pulls(best, edge, reach * edge.crop.side)
        if pulls is None:
            break
        best = again(best, _joined(seen, pulls), known)
    return best


def outline_overlap(fit: Fit, edge: Edge) -> float:
    """Intersection over union of a fitted arm, drawn small, with its mask.

    Beyond the picture nobody knows.
    """
    mine, mask = _drawn(fit, edge.crop, GRID).mask & edge.inside, edge.mask & edge.inside
    return float((mine & mask).sum() / max((mine | mask).sum(), 1))


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


@dataclass(frozen=True)
class _Drawn:
    """An arm as a crop shows it.

    Attributes:
        depth, face: see :func:`~armsight.recognition.own_arm.surface.drawn`.
        poses: (links, 4, 4) ``T_crop_link``.
        owner: (triangles,) link of each.
    """

    depth: DepthImage
    face: Ints32
    poses: Poses
    owner: Ints

    @property
    def mask(self) -> Mask:
        """(h, w) where the arm is."""
        return np.asarray(self.face >= 0)


def _drawn(fit: Fit, crop: Crop, grid: int = 1) -> _Drawn:
    """A fitted arm as a crop shows it, of which one pixel is ``grid`` pixels wide."""
    surface, side = arm_surface(fit.robot), crop.side // grid
    f, middle = crop.f / grid, 0.5 * (side - 1)
    lens = np.array([f, f, middle, middle, 0, 0, 0, 0, 0.0])
    poses = np.ascontiguousarray(fit.T_camera_base @ link_poses(fit.robot, fit.q))
    seen = carried_points(poses, surface.link, surface.vertices)
    depth, face = drawn(surface, seen, lens, (side, side))
    return _Drawn(depth, face, poses, surface.face_link)


def within(crop: Crop, side: int) -> Mask:
    """(side, side) where a crop lies within the picture."""
    small = cv2.resize(crop.inside.astype(np.uint8), (side, side), interpolation=cv2.INTER_NEAREST)
    return np.asarray(small > 0)


def _pulls(fit: Fit, edge: Edge, reach: float) -> Observations | None:
    """Points of the outline and where on the mask's edge they should be."""
    drawn_fit, crop = _drawn(fit, edge.crop, GRID), edge.crop
    found, link, point, at, covariance = rim_pulls(
        drawn_fit.depth, drawn_fit.face, drawn_fit.owner, drawn_fit.poses, crop.f / GRID,
        edge.distance, edge.away, reach / GRID, SHARP / crop.f, ALONG / crop.f, ALIKE,
    )  # fmt: skip
    if found < FEWEST:
        return None
    return Observations(link, point, at, covariance, np.full(len(link), -1.0))


def _joined(a: Observations, b: Observations) -> Observations:
    return Observations(*(np.concatenate([getattr(a, k), getattr(b, k)]) for k in vars(a)))
