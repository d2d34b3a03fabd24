"""A palm: the blue disc on a pink glove; where something hides the disc, the glove stands in.

V lost the disc behind the item in the gripper, and with it its hand-overs. Here each camera
remembers where the disc was on the glove that it sees.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from armsight.arrays import Bytes, ColorImage, Points, Vector3
from armsight.devices.data import StereoFrame
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.disc_fit import meet, plane_of
from armsight.servoing.segment import LabColor, Region, color_mask, regions
from armsight.servoing.sighting import Sighting
from armsight.servoing.targets.discs import Discs, Part, SeenDisc
from armsight.servoing.targets.rehearsal import Disc, rehearse
from armsight.servoing.targets.seen import LEAST, points_of, rays_of

BLUE = LabColor(hue_deg=295.0, width_deg=20.0)
PINK = LabColor(hue_deg=350.0, width_deg=22.0)
DISC = Part(0.022)
"""The disc on the palm [m]."""
AROUND = 0.05
"""The glove so far around a blue disc is the palm [m]."""
DISC_SIGMA = 0.003
"""Standard deviation of a disc of a few pixels, seen aslant by a fixed camera [m]."""
FOREARM = 0.15
"""No finger reaches so far from the palm's middle [m]; a forearm does."""
STANDS_IN = 0.015
"""Standard deviation of a palm of which only the glove is seen [m]; by how much less or more of it
is seen than was with the disc, it is larger."""
UNLIKE = 0.08
"""A glove that is seen so much longer or shorter than with the disc says nothing [m]."""
LENGTH = 0.45
"""Glove and sleeve reach so far towards a camera or away from it [m]."""
RING = (1.2, 1.5)
"""A palm's disc has the glove's colour around it: between so many of its radii, ..."""
PINKISH = 0.6
"""... where this share of the pixels has it."""


class Palm:
    """Finds the palm of a gloved hand."""

    name = "palm"

    def __init__(self) -> None:
        self._discs = Discs(BLUE, (DISC,))
        self._glove: dict[str, tuple[Vector3, Vector3]] = {}

    def reset(self) -> None:
        """Where the disc is on the glove has not been seen."""
        self._glove.clear()

    def warm_up(self) -> None:
        """Compile what finds it."""
        rehearsed()

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """In the colour and depth of one camera: the disc on the glove, else the glove."""
        frame, lens, T = view.frame, view.color_lens, view.T_base_color
        if frame.color is None or lens is None or T is None or view.T_base_camera is None:
            return []
        pink, blue = color_mask(frame.color, PINK), color_mask(frame.color, BLUE)
        parts = [points_of(view, region, LENGTH) for region in regions(pink, LEAST)]
        glove = np.concatenate([np.empty((0, 3)), *parts])
        if len(glove) < 12:
            return []
        # Of its outline, not of what is seen inside: an item before the palm moves that.
        low, high = np.percentile(glove, [2.0, 98.0], axis=0)
        middle, size = 0.5 * (low + high), high - low
        for region in regions(blue, LEAST):
            ray = T[:3, :3] @ rays_of(lens, region.center[None])[0]
            seen = _on_glove(T[:3, 3], ray, _around(view, region, pink | blue))
            if seen is not None:
                place, normal = seen
                self._glove[frame.camera] = place - middle, size
                C = DISC_SIGMA**2 * np.eye(3)
                along = _forearm(glove, place)
                return [
                    Sighting(
                        self.name, frame.camera, frame.stamp, place, C, place, normal, False, 0.1,
                        along,
                    )
                ]  # fmt: skip
        known = self._glove.get(frame.camera)
        if known is None:
            return []
        offset, whole = known
        unlike = float(np.abs(size - whole).max())
        if unlike > UNLIKE:
            return []
        C = (STANDS_IN**2 + unlike**2) * np.eye(3)
        return [Sighting(self.name, frame.camera, frame.stamp, middle + offset, C, middle)]

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """In both pictures of a pair, the most believable first; else in one of them.

        What the gripper holds hides the disc from one lens long before it does from the other.
        """
        if view.T_base_camera is None:
            return []
        return [_of_disc(seen, view.frame) for seen in self._discs.in_pair(view, _pink_around)]


def _around(view: PosedFrame, region: Region, mask: Bytes) -> Points:
    """(k, 3) depth points of a mask near a disc that a fixed camera sees, in ``base`` [m]."""
    assert view.color_lens is not None
    assert view.T_base_color is not None
    inside = points_of(view, region)
    if not len(inside):
        return inside
    away = float(np.median(np.linalg.norm(inside - view.T_base_color[:3, 3], axis=1)))
    reach = int(np.ceil(AROUND * view.color_lens.fx / away))
    u, v = np.rint(region.center).astype(int)
    u0, v0 = max(u - reach, 0), max(v - reach, 0)
    window = mask[v0 : v + reach + 1, u0 : u + reach + 1]
    near = Region(window, (int(u0), int(v0)), region.center, float(np.count_nonzero(window)))
    return points_of(view, near)


def _pink_around(image: ColorImage, region: Region) -> bool:
    """Whether a disc lies on a glove."""
    half = 0.5 * max(region.mask.shape)
    reach = int(np.ceil(RING[1] * half)) + 1
    u, v = region.center
    u0, v0 = max(int(u) - reach, 0), max(int(v) - reach, 0)
    window = image[v0 : int(v) + reach + 1, u0 : int(u) + reach + 1]
    rows, columns = np.indices(window.shape[:2])
    away = np.hypot(columns + u0 - u, rows + v0 - v) / half
    ring = (away > RING[0]) & (away < RING[1])
    pink = color_mask(np.ascontiguousarray(window), PINK)[ring] > 0
    return bool(ring.any() and pink.mean() > PINKISH)


def _on_glove(origin: Vector3, ray: Vector3, glove: Points) -> tuple[Vector3, Vector3] | None:
    """Where (3,) a ray meets the glove around it, and its normal there; None where it passes it."""
    to = glove - origin
    beside = np.linalg.norm(to - (to @ ray)[:, None] * ray, axis=1)
    near = glove[beside < AROUND]
    if len(near) < 12:
        return None
    middle, normal = plane_of(near, origin)
    if abs(float(normal @ ray)) < 0.15:
        return None  # seen from the edge
    place = meet(origin, ray[None], middle, normal)[0]
    if np.linalg.norm(place - middle) > AROUND:
        return None
    return np.asarray(place), normal


def _forearm(glove: Points, palm: Vector3) -> Vector3 | None:
    """(3,) unit from the palm along the forearm; None where too little of that is seen."""
    way = glove - palm
    way = way[np.linalg.norm(way, axis=1) > FOREARM]
    if len(way) < 6:
        return None
    middle = way.mean(axis=0)
    return np.asarray(middle / np.linalg.norm(middle))


def _of_disc(seen: SeenDisc, frame: StereoFrame) -> Sighting:
    fit = seen.fit
    normal, tilt = (fit.normal, fit.tilt) if seen.turned else (None, 0.0)
    return Sighting(
        Palm.name, frame.camera, frame.stamp, fit.center, fit.covariance, seen.surface, normal,
        True, tilt,
    )  # fmt: skip


@cache
def rehearsed() -> tuple[Sighting, ...]:
    """A painted palm, looked for once."""
    glove, disc = Disc(0.06, (242, 77, 158)), Disc(DISC.radius, (20, 51, 191))
    return tuple(rehearse(Palm(), (glove, disc)))
