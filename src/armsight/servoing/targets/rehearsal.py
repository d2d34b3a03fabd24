"""A target painted flat and looked for, once, before it matters: all that finds it is compiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from armsight.arrays import ColorImage, Points
from armsight.devices.data import DepthNoise, RgbdCameraInfo, RgbdFrame, StereoFrame, StereoInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.sighting import Sighting

LENS = PinholeCamera(360, 240, 430.0, 430.0, 180.0, 120.0)
FAR, NEAR, APART = 0.9, 0.3, 0.06
"""How far before a camera it is painted, and before a pair, whose lenses are so far apart [m]."""
WALL = (120, 122, 118)


@dataclass(frozen=True)
class Disc:
    """A disc of a radius [m] and an RGB colour, facing the lens, beside its axis by (x, y) [m]."""

    radius: float
    color: tuple[int, int, int]
    at: tuple[float, float] = (0.0, 0.0)


def rehearse(target: Any, print_: Sequence[Disc], nearer: float = 0.0) -> list[Sighting]:
    """Let a target be looked for in made-up pictures of one camera, and of a pair.

    Args:
        target: with ``in_frame`` and ``in_pair``.
        print_: the discs that it consists of, each over those before it.
        nearer: what depth sees of it lies nearer than its outline by so much [m], as of a ball.

    Returns:
        What was found, in either.
    """
    return [*target.in_frame(_frame(print_, nearer)), *target.in_pair(_pair(print_))]


def _frame(print_: Sequence[Disc], nearer: float) -> PosedFrame:
    depth = np.full((LENS.height, LENS.width), FAR - nearer, np.float32)
    info = RgbdCameraInfo(
        "rehearsal", "painted", LENS, LENS, np.eye(4), "base", np.eye(4), 15.0, 0.04, (0.2, 4.5),
        DepthNoise(0.002, 0.0, 0.0),
    )  # fmt: skip
    frame = RgbdFrame("rehearsal", 0, 1.0, 1.04, depth, _painted(print_, FAR, 0.0))
    return PosedFrame(frame, info, None, np.eye(4), LENS)


def _pair(print_: Sequence[Disc]) -> PosedPair:
    T = make_pose(None, (APART, 0.0, 0.0))
    left, right = (_painted(print_, NEAR, 0.5 * APART * side) for side in (1.0, -1.0))
    info = StereoInfo("rehearsal", "painted", LENS, LENS, T, "base", np.eye(4), 10.0, 0.05)
    return PosedPair(StereoFrame("rehearsal", 0, 1.0, 1.05, left, right), info, None, np.eye(4))


def _painted(print_: Sequence[Disc], away: float, aside: float) -> ColorImage:
    """(h, w, 3) a print so far before a lens, and so far beside its axis [m]."""
    picture = np.full((LENS.height, LENS.width, 3), WALL, np.uint8)
    turn = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    around = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], axis=1)
    for disc in print_:
        x, y = disc.at
        rim: Points = disc.radius * around + np.array([x + aside, y, away])
        pixels = [np.round(16.0 * LENS.project(rim)).astype(np.int32)]
        cv2.fillPoly(picture, pixels, disc.color, cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.uint8)
