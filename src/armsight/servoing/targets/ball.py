"""The red ball: V's thresholds in Lab, and past V the sphere's true centre.

V takes the mean of the region's registered points, which lies two thirds of the radius before the
centre. Here the centre is fitted to the sub-pixel outline, by its tangent cone, and to the depth
points inside it. What is no ball of the right size at that distance is no ball: a red shirt, a
picture of one, the stylus' own tip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from armsight.arrays import ColorImage, Points, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import transform
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.planes import plane_sweep
from armsight.servoing.segment import SPOKES, LabColor, Region
from armsight.servoing.sighting import Sighting
from armsight.servoing.sphere_fit import BallFit, Cone, Outline, fit_ball, tangent_cone
from armsight.servoing.targets.rehearsal import Disc, rehearse
from armsight.servoing.targets.seen import (
    outlines_in_frame,
    outlines_in_pair,
    own_outline,
    points_of,
)

RED = LabColor(hue_deg=36.0, width_deg=24.0)
"""Of the ball, and of the mark on the stylus."""
OUTLINE_SIGMA = 0.25
"""Of a point of an outline [px]: rays of one region share some of it."""
DEPTH_SIGMA = 0.004
"""Of a depth camera's point on a curved surface [m]; its systematic error is the filter's bias."""
SIZE = 0.22
"""A ball's size may contradict its distance by this share."""
PARTLY = 1.0
"""An outline lies off by a part of a pixel all around, which moves no centre while it is whole: of
one of which a share is hidden the centre is unsure by this times that share [px]."""


@dataclass(frozen=True)
class Seen:
    """A ball in the frame ``base``: its fit, and the mean of its visible surface (3,) [m]."""

    fit: BallFit
    surface: Vector3


class PairCones:
    """Tangent cones of a colour in a pair's newest pictures, found once for all balls that have it.

    Args:
        color: to look for.
    """

    def __init__(self, color: LabColor) -> None:
        self.color = color
        self._view: PosedPair | None = None
        self._found: list[list[tuple[Region, Cone]]] = []

    def of(self, view: PosedPair) -> list[list[tuple[Region, Cone]]]:
        """Regions and the cones of their outlines, in the left and in the right picture."""
        if view is not self._view:
            frame, info = view.frame, view.info
            sides = ((frame.left, info.left), (frame.right, info.right))
            self._found = [self._in_one(image, lens) for image, lens in sides]
            self._view = view
        return self._found

    def _in_one(self, image: ColorImage, lens: PinholeCamera) -> list[tuple[Region, Cone]]:
        outlines = outlines_in_pair(image, lens, self.color)
        cones = [(region, tangent_cone(rays, OUTLINE_SIGMA / lens.fx)) for region, rays in outlines]
        return [(region, cone) for region, cone in cones if cone is not None]


class Ball:
    """Finds a red ball of known radius.

    Args:
        radius: of the ball [m]; name: of the target; color: of the ball.
        beside: another ball of this colour that is looked for in the same pictures of a pair.
    """

    def __init__(
        self,
        radius: float = 0.04,
        name: str = "ball",
        color: LabColor = RED,
        beside: Ball | None = None,
    ) -> None:
        self.radius, self.name, self.color = radius, name, color
        same = beside is not None and beside.color == color
        self._cones: PairCones = beside._cones if beside is not None and same else PairCones(color)

    def warm_up(self) -> None:
        """Compile what finds balls."""
        rehearsed()

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """Balls in the colour and depth of one camera, the most believable first."""
        frame, lens, T = view.frame, view.color_lens, view.T_base_color
        if frame.color is None or lens is None or T is None or view.T_base_camera is None:
            return []
        found = []
        for region, rays in outlines_in_frame(frame.color, lens, self.color):
            seen = self._fit_one(view, region, rays)
            if seen is not None:
                found.append(seen)
        found.sort(key=lambda seen: -seen.fit.share)
        return [self._sighting(seen, frame.camera, frame.stamp, False) for seen in found]

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """Balls in both pictures of a pair, the most believable first.

        Args:
            view: the pair.
            surface: measure the visible surface by V's thirty planes, too.
        """
        T = view.T_base_camera
        if T is None:
            return []
        cones = self._cones.of(view)
        poses = (T, np.asarray(T @ view.info.T_left_right))
        found: list[tuple[Seen, Region]] = []
        for region, left in cones[0]:
            fits = [self._fit_two(poses, left, right, view) for _, right in cones[1]]
            good = [fit for fit in fits if fit is not None]
            if good:
                best = min(good, key=lambda fit: fit.misfit)
                to = poses[0][:3, 3] - best.center
                near = best.center + 2.0 / 3.0 * self.radius * to / np.linalg.norm(to)
                found.append((Seen(best, near), region))
        found.sort(key=lambda pair: pair[0].fit.misfit)
        if surface:
            found = [(Seen(s.fit, _swept(view, T, r, s.surface)), r) for s, r in found]
        frame = view.frame
        return [self._sighting(s, frame.camera, frame.stamp, True) for s, _ in found]

    def _fit_one(self, view: PosedFrame, region: Region, rays: Points) -> Seen | None:
        """From one lens's outline and what depth there is inside it."""
        lens, T, points = view.color_lens, view.T_base_color, points_of(view, region)
        if lens is None or T is None or len(points) < 4:
            return None
        sigma, eye = OUTLINE_SIGMA / lens.fx, T[:3, 3]
        middle = np.median(points, axis=0)
        by_depth = float(np.linalg.norm(middle - eye)) + 0.75 * self.radius
        cone = tangent_cone(rays[own_outline(view, region, rays, by_depth - self.radius)], sigma)
        if cone is None:
            return None
        by_size = self.radius / np.sin(cone.half)
        # An outline of a few pixels says little of the size.
        pixels = cone.half * lens.fx
        if abs(by_size / by_depth - 1.0) > max(SIZE, 1.2 / pixels):
            return None
        start = eye + T[:3, :3] @ cone.axis * by_depth
        near = np.linalg.norm(points - start, axis=1) < 1.6 * self.radius
        away = np.linalg.norm(np.cross(points - eye, (start - eye) / by_depth), axis=1)
        inner = points[near & (away < 0.8 * self.radius)]
        if len(inner) < 4:
            return None
        fit = fit_ball(
            self.radius,
            start,
            [Outline(eye, cone.rays @ T[:3, :3].T, sigma)],
            inner,
            DEPTH_SIGMA,
        )
        if fit is None or fit.share < 0.5 or fit.misfit > 2.5:
            return None
        hidden = max(1.0 - len(cone.rays) / SPOKES, 0.0)
        unsure = (PARTLY * hidden / lens.fx * by_depth) ** 2
        fit = replace(fit, covariance=fit.covariance + unsure * np.eye(3))
        return Seen(fit, points.mean(axis=0))

    def _fit_two(
        self, poses: tuple[Pose, Pose], left: Cone, right: Cone, view: PosedPair
    ) -> BallFit | None:
        """From the outlines of both lenses, if they are of one ball of the right size."""
        cones, starts = (left, right), []
        lenses = (view.info.left, view.info.right)
        for T, cone in zip(poses, cones):
            away = self.radius / np.sin(cone.half)
            starts.append(T[:3, 3] + T[:3, :3] @ cone.axis * away)
        eye = poses[0][:3, 3]
        if np.linalg.norm(starts[0] - starts[1]) > SIZE * np.linalg.norm(starts[0] - eye):
            return None
        outlines = [
            Outline(T[:3, 3], cone.rays @ T[:3, :3].T, OUTLINE_SIGMA / lens.fx)
            for T, cone, lens in zip(poses, cones, lenses)
        ]
        fit = fit_ball(self.radius, 0.5 * (starts[0] + starts[1]), outlines)
        if fit is None or fit.share < 0.5 or fit.misfit > 2.5:
            return None
        # A ball of another size is fitted too, elsewhere: what both lenses agree on is the cones.
        if any(
            np.linalg.norm(fit.center - s) > 0.1 * np.linalg.norm(s - poses[0][:3, 3])
            for s in starts
        ):
            return None
        return fit

    def _sighting(self, seen: Seen, camera: str, stamp: float, wrist: bool) -> Sighting:
        return Sighting(
            self.name,
            camera,
            stamp,
            seen.fit.center,
            seen.fit.covariance,
            seen.surface,
            None,
            wrist,
        )


@cache
def rehearsed() -> tuple[Sighting, ...]:
    """A painted ball, looked for once."""
    return tuple(rehearse(Ball(0.04), (Disc(0.04, (205, 30, 25)),), 0.03))


def _swept(view: PosedPair, T: Pose, region: Region, otherwise: Vector3) -> Vector3:
    """Mean of a region's surface in ``base`` by V's planes."""
    points = plane_sweep(view, region)
    return transform(T, points).mean(axis=0) if len(points) else otherwise
