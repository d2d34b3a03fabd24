"""The end of a straw on the tool, in the pair on the wrist: where the pair says that the tip is.

Both are on the flange, so that what the pair errs by shows there. The end is round: its middle lies
by the straw's radius before where it ends in the picture, on the straw's middle line.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import ColorImage, Floats, Points, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.segment import LabColor, color_mask, regions
from armsight.servoing.sighting import Sighting
from armsight.servoing.targets.seen import meeting, rays_of

GREEN = LabColor(hue_deg=146.0, width_deg=22.0, purity=0.4)
SIGHT = 0.04
"""So much of the straw before its end is looked at [m]."""
ASIDE = 0.012
"""It is looked for so far around where the joints say [m]."""
LEAST = 0.5
"""Share of that length of a straw that has to be seen."""
SIGMA = 0.6
"""Of its end in a picture [px]."""
MEET = 0.003
"""Both lenses' rays to it pass each other by no more than this [m]."""


class StrawEnd:
    """Finds the end of a straw that is held before a pair.

    Args:
        robot: the arm with its tool.
        end: (3,) middle of the straw's round end in the TCP's frame [m].
        axis: (3,) unit, along the straw to its end, in that frame.
        radius: of the straw [m].
    """

    name = "mark"

    def __init__(self, robot: Robot, end: Vector3, axis: Vector3, radius: float) -> None:
        self._robot, self._end, self._axis, self._radius = robot, end, axis, radius

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """Only the pair is near enough."""
        return []

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """The end's middle, where both lenses show it."""
        if view.T_base_camera is None or view.joints is None:
            return []
        tool = tcp_pose(self._robot, view.joints.position)
        ends = np.stack([self._end, self._end - SIGHT * self._axis])
        expected = transform(tool, ends)
        info, frame, left = view.info, view.frame, view.T_base_camera
        right = np.asarray(left @ info.T_left_right)
        origins, rays = [], []
        for image, lens, T in ((frame.left, info.left, left), (frame.right, info.right, right)):
            pixel = self._in_one(image, lens, transform(inverse(T), expected))
            if pixel is None:
                return []
            origins.append(T[:3, 3])
            rays.append(T[:3, :3] @ rays_of(lens, pixel[None])[0])
        return self._met(view, origins, rays, info.left.fx)

    def _in_one(self, image: ColorImage, lens: PinholeCamera, expected: Points) -> Floats | None:
        """(2,) pixel of the end's middle; None without one.

        Args:
            image: of one lens.
            lens: it.
            expected: (2, 3) the end's middle, and a place before it, in its frame [m].
        """
        end, before = lens.project(expected)
        scale = lens.fx / float(expected[0, 2])
        along = end - before
        length = float(np.linalg.norm(along))
        if not (expected[:, 2] > 0.02).all() or not length > 3.0 * scale * self._radius:
            return None  # it is seen from its end, or not at all
        along = along / length
        axes = np.array([along, (-along[1], along[0])])
        low = np.floor(np.minimum(end, before) - ASIDE * scale).astype(int)
        high = np.ceil(np.maximum(end, before) + ASIDE * scale).astype(int) + 1
        low, high = np.maximum(low, 0), np.minimum(high, [lens.width, lens.height])
        if (high - low < 8).any():
            return None
        window = image[low[1] : high[1], low[0] : high[0]]
        found = regions(color_mask(np.ascontiguousarray(window), GREEN), 1, most=1)
        if not found:
            return None
        straw = np.argwhere(found[0].mask)[:, ::-1] + np.array(found[0].corner, float)
        middle = _round_end((straw + low - before) @ axes.T, length, scale * self._radius)
        return None if middle is None else np.asarray(before + middle @ axes)

    def _met(
        self, view: PosedPair, origins: list[Vector3], rays: list[Vector3], fx: float
    ) -> list[Sighting]:
        """Where two rays meet."""
        away, place, gap = meeting(origins[0], rays[0], origins[1], rays[1])
        if (away < 0.02).any() or gap > MEET:
            return []
        base = float(np.linalg.norm(origins[1] - origins[0]))
        side = SIGMA * float(away[0]) / fx
        deep = side * float(away[0]) / max(base, 1e-6)
        ray = rays[0]
        covariance = side**2 * np.eye(3) + deep**2 * np.outer(ray, ray)
        frame = view.frame
        return [
            Sighting(self.name, frame.camera, frame.stamp, place, covariance, place, None, True)
        ]


def _round_end(pixels: Floats, length: float, radius: float) -> Floats | None:
    """(2,) middle of the round end of a straw's pixels (k, 2), along it and across [px].

    None where they are not as long, or as wide, as a straw of a length and radius [px].
    """
    t, s = pixels.T
    last = float(np.percentile(t, 99.5))
    body = (t > last - length) & (t < last - 1.5 * radius)
    if last - float(t.min()) < LEAST * length or np.count_nonzero(body) < 20:
        return None
    slope, offset = np.polyfit(t[body], s[body], 1)
    aside = s - (slope * t + offset)
    width = 2.0 * float(np.percentile(np.abs(aside[body]), 90.0)) / 0.9
    if not 0.6 < width / (2.0 * radius) < 1.5:
        return None
    tops = []
    for u in (-0.45, -0.15, 0.15, 0.45):
        lane = np.abs(aside - u * radius) < 0.5
        if not lane.any():
            return None
        tops.append(float(t[lane].max()) + 0.5 - radius * np.sqrt(1.0 - u * u))
    middle = float(np.median(tops))
    return np.array([middle, slope * middle + offset])
