"""Printed discs and rings of one colour: their place and normal in a picture, or in a pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from armsight.arrays import ColorImage, Points, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import unit
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.disc_fit import Circle, DiscFit, across, fit_disc, meet, plane_of
from armsight.servoing.segment import SPOKES, LabColor, Region
from armsight.servoing.sphere_fit import Outline
from armsight.servoing.targets.seen import (
    meeting,
    outlines_in_frame,
    outlines_in_pair,
    own_outline,
    points_of,
)

OUTLINE_SIGMA = 0.25
"""Of a point of an outline [px]: neighbours share some of it."""
DEPTH_SIGMA = 0.004
"""Of a depth point on a plane [m]; hundreds of them share the camera's systematic error, so ..."""
MOST_POINTS = 40
"""... no more of them are believed than these."""
SIZE = 0.22
"""A disc's size may contradict its distance by this share."""
FILL = 0.3
"""And how much of its outline is filled, what it should be."""
GAP = 4
"""From a fixed camera rings are lines of two pixels, in pieces: what is no farther apart is one
print [px]."""
WHOLE = 0.9
"""Of an outline's spokes that must have found it where one picture alone shows a disc."""
LEAST_OF_ELLIPSE = 20
"""Fewer points of an outline say nothing of its ellipse."""
APART = 0.01
"""The rays of two lenses to one disc's middle pass each other by no more than this [m]."""
TILTS = ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5))
"""Where a pair's fit begins: seen aslant an ellipse says little of which side is nearer."""


@dataclass(frozen=True)
class Part:
    """One connected part of a print: its outer radius [m], and how much of that it fills."""

    radius: float
    fill: float = 1.0


@dataclass(frozen=True)
class SeenDisc:
    """A print in ``base``.

    Attributes:
        fit: of its circles; surface: (3,) mean of what is visible of it [m].
        region: its largest part in the (left) picture.
        parts: how many of its parts were found.
        turned: whether ``fit.normal`` says how it is turned: one picture without depth does not
            tell which of its sides is nearer.
    """

    fit: DiscFit
    surface: Vector3
    region: Region
    parts: int
    turned: bool = True


@dataclass(frozen=True)
class _Candidate:
    """A region that may be a part of the print, where it may be, seen by one lens or two."""

    part: Part
    circles: tuple[Circle, ...]
    center: Vector3
    normal: Vector3
    region: Region
    points: Points


class Discs:
    """Finds a print of concentric circles.

    Args:
        color: of its parts; parts: the largest first.
    """

    def __init__(self, color: LabColor, parts: Sequence[Part]) -> None:
        self.color, self.parts = color, tuple(parts)
        largest = self.parts[0].radius
        fill = sum(part.fill * (part.radius / largest) ** 2 for part in self.parts)
        self._whole = Part(largest, fill)
        self._gap = GAP if len(self.parts) > 1 else 0

    def in_frame(self, view: PosedFrame) -> list[SeenDisc]:
        """Prints in the colour and depth of one camera, the most believable first."""
        frame, lens, T = view.frame, view.color_lens, view.T_base_color
        if frame.color is None or lens is None or T is None or view.T_base_camera is None:
            return []
        candidates = []
        for region, rays in outlines_in_frame(frame.color, lens, self.color, self._gap):
            points = points_of(view, region)
            if len(points) < 6:
                continue
            nearest = float(np.linalg.norm(points - T[:3, 3], axis=1).min())
            rays = rays[own_outline(view, region, rays, nearest)]
            if len(rays) < 8:
                continue
            outline = Outline(T[:3, 3], rays @ T[:3, :3].T, OUTLINE_SIGMA / lens.fx)
            middle, normal = plane_of(points, outline.origin)
            part = self._whole
            found = _fitting(part, region, outline, middle, normal, lens)
            if found is not None:
                circle = Circle(outline, part.radius)
                candidates.append(_Candidate(part, (circle,), found, normal, region, points))
        return self._best(candidates)

    def in_pair(
        self, view: PosedPair, alone: Callable[[ColorImage, Region], bool] | None = None
    ) -> list[SeenDisc]:
        """Prints in both pictures of a pair, the most believable first.

        Args:
            view: the pair.
            alone: whether a region of a picture may be a whole disc that this one shows alone; such
                are looked for where both show none. None: they are not.
        """
        T = view.T_base_camera
        if T is None:
            return []
        lenses, images = (view.info.left, view.info.right), (view.frame.left, view.frame.right)
        poses = (T, np.asarray(T @ view.info.T_left_right))
        seen = [
            [
                (region, Outline(pose[:3, 3], rays @ pose[:3, :3].T, OUTLINE_SIGMA / lens.fx))
                for region, rays in outlines_in_pair(image, lens, self.color)
            ]
            for image, lens, pose in zip(images, lenses, poses)
        ]
        candidates = []
        for (region, left), (_, right) in product(*seen):
            middle = between(left, right)
            if middle is None:
                continue
            normal = unit(left.origin - middle)
            for part in self.parts:
                found = _fitting(part, region, left, middle, normal, lenses[0], 2.0 * SIZE)
                if found is not None:
                    circles = (Circle(left, part.radius), Circle(right, part.radius))
                    none = np.empty((0, 3))
                    candidates.append(_Candidate(part, circles, middle, normal, region, none))
        both = self._best(candidates)
        if both or alone is None:
            return both
        return [
            disc
            for image, lens, outlines in zip(images, lenses, seen)
            for disc in self._in_one(outlines, lens)
            if alone(image, disc.region)
        ]

    def _in_one(
        self, outlines: Sequence[tuple[Region, Outline]], lens: PinholeCamera
    ) -> list[SeenDisc]:
        """Whole discs in one picture of a pair: how far away each is, its size alone tells."""
        candidates, part = [], self.parts[0]
        for region, outline in outlines:
            if len(outline.rays) < WHOLE * SPOKES:
                continue
            axis = outline.rays.mean(axis=0) / np.linalg.norm(outline.rays.mean(axis=0))
            away = part.radius / float(np.sqrt(1.0 / (outline.rays @ axis).min() ** 2 - 1.0))
            middle = np.asarray(outline.origin + away * axis)
            if _fitting(part, region, outline, middle, -axis, lens, 1.0) is None:
                continue
            circles, none = (Circle(outline, part.radius),), np.empty((0, 3))
            candidates.append(_Candidate(part, circles, middle, -axis, region, none))
        return [
            _less_sure(seen, outlines[0][1].origin, part.radius, lens)
            for seen in self._best(candidates)
        ]

    def _best(self, candidates: list[_Candidate]) -> list[SeenDisc]:
        """Fits of every candidate with the others that share its middle."""
        found: list[SeenDisc] = []
        for one in candidates:
            if any(np.linalg.norm(s.fit.center - one.center) < one.part.radius for s in found):
                continue  # it is in one that was found already
            mates = [
                c
                for c in candidates
                if c is one
                or (c.part != one.part and np.linalg.norm(c.center - one.center) < APART)
            ]
            circles = [circle for c in mates for circle in c.circles]
            points = one.points[:: max(len(one.points) // MOST_POINTS, 1)]
            fit = _fit(one.center, one.normal, circles, points)
            if fit is not None:
                middle = one.points.mean(axis=0) if len(one.points) else fit.center
                found.append(SeenDisc(fit, middle, one.region, len(mates)))
        found.sort(key=lambda s: (-s.parts, s.fit.misfit))
        return found


def _less_sure(seen: SeenDisc, eye: Vector3, radius: float, lens: PinholeCamera) -> SeenDisc:
    """Along the ray by how much of its size an outline that lies half a pixel off makes."""
    to = seen.fit.center - eye
    away = float(np.linalg.norm(to))
    off = 0.5 / lens.fx * away * away / radius
    unsure = seen.fit.covariance + np.outer(to, to) * (off / away) ** 2
    return replace(seen, fit=replace(seen.fit, covariance=unsure), turned=False)


def _fitting(
    part: Part,
    region: Region,
    outline: Outline,
    middle: Vector3,
    normal: Vector3,
    lens: PinholeCamera,
    size: float = SIZE,
) -> Vector3 | None:
    """(3,) middle of an outline on a plane if it can be that of a part; None if it cannot."""
    toward = outline.rays @ normal
    if (toward > -0.15).any():
        return None  # seen from the edge, or from behind
    on_plane = meet(outline.origin, outline.rays, middle, normal)
    center = 0.5 * (on_plane.min(axis=0) + on_plane.max(axis=0))
    radius = float(np.median(np.linalg.norm(on_plane - center, axis=1)))
    if len(on_plane) < 40:  # part of it is hidden, or beyond the picture: any size may be
        size *= 1.5
    pixels = part.radius * lens.fx / max(float(np.linalg.norm(middle - outline.origin)), 1e-6)
    if abs(radius / part.radius - 1.0) > max(size, 1.2 / max(pixels, 1e-6)):
        return None
    if abs(region.area / region.hull - part.fill) > FILL:
        return None
    return np.asarray(center)


def between(left: Outline, right: Outline, apart: float = APART) -> Vector3 | None:
    """(3,) where the middle rays of two lenses nearly meet [m]; None where they do not."""
    means = [_mean_ray(left), _mean_ray(right)]
    wholes = [_whole_ray(left, means[0]), _whole_ray(right, means[1])]
    cut = any(whole is not mean for whole, mean in zip(wholes, means))
    for a, b in (wholes, means) if cut else (means,):
        along, place, gap = meeting(left.origin, a, right.origin, b)
        if (along >= 0.05).all() and (along <= 2.0).all() and gap <= apart:
            return place
    return None


def _mean_ray(outline: Outline) -> Vector3:
    """(3,) unit ray to the middle of what is seen of an outline."""
    mean = outline.rays.mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _whole_ray(outline: Outline, mean: Vector3) -> Vector3:
    """(3,) unit ray to the middle of an outline's whole ellipse; the mean where it is not cut off.

    Where the picture cuts it off the two differ, and each from lens to lens.
    """
    if not LEAST_OF_ELLIPSE <= len(outline.rays) < WHOLE * SPOKES:
        return mean
    x, y = across(mean)
    flat = outline.rays @ np.stack([x, y], axis=1) / (outline.rays @ mean)[:, None]
    (u, v), *_ = cv2.fitEllipseDirect((1e3 * flat).astype(np.float32)[:, None])
    if not np.hypot(u, v) < 1e3 * np.linalg.norm(flat, axis=1).max():
        return mean
    middle = mean + 1e-3 * (u * x + v * y)
    return np.asarray(middle / np.linalg.norm(middle))


def _fit(
    center: Vector3, normal: Vector3, circles: Sequence[Circle], points: Points
) -> DiscFit | None:
    """The first good fit of several starts; with depth the first start is good."""
    x, y = across(normal)
    best: DiscFit | None = None
    for a, b in TILTS[:1] if len(points) else TILTS:
        fit = fit_disc(center, normal + a * x + b * y, circles, points, DEPTH_SIGMA)
        if fit is None or fit.share < 0.5:
            continue
        if best is None or fit.misfit / fit.share < best.misfit / best.share:
            best = fit
        if best.share > 0.85 and best.misfit < 1.2:
            break
    return best if best is not None and best.misfit < 2.5 else None
