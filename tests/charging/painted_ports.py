"""Ports painted flat by their outlines, without a renderer: what the finder's tests look at."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.charging.ports.outline import Outline
from armsight.charging.ports.table import Port
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.stereo import StereoPair, converging_pair

LENS = PinholeCamera(640, 480, 800.0, 800.0, 321.0, 238.0)
PAIR: StereoPair = converging_pair(LENS, 0.15, np.deg2rad(12.0))
FINE = 6
"""Subpixels a side."""


def facing(x: float, y: float, z: float, lean: tuple[float, float], roll: float) -> Pose:
    """A port before the camera, leaning about its x and y, rolled; angles in rad."""
    turn = from_rpy((np.pi, 0, 0))[:3, :3] @ from_rpy((lean[0], lean[1], 0))[:3, :3]
    return make_pose(turn @ from_rpy((0, 0, roll))[:3, :3], (x, y, z))


def paint(port: Port, T: Pose, lens: PinholeCamera, seed: int, contrast: float = 1.0) -> Bytes:
    """A grey picture of a port on a wall, with noise."""
    rng = np.random.default_rng(seed)
    picture = np.full((lens.height * FINE, lens.width * FINE), 120.0, np.float32)
    dark, face = 60 - 45 * contrast, 60.0
    _fill(picture, [port.plate], 0.0, T, lens, face)
    mouths = port.of_kind("mouth")
    _fill(picture, [rim.outline for rim in mouths], mouths[0].z, T, lens, dark)
    for kind, level in (("pedestal", face), ("recess", dark)):
        for rim in port.rims:
            if rim.kind == kind:
                _fill(picture, [rim.outline], rim.z, T, lens, level)
    small = cv2.resize(picture, (lens.width, lens.height), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 0.6) + rng.normal(0, 1.0, small.shape)
    return np.clip(small + 0.5, 0, 255).astype(np.uint8)


def _fill(
    picture: np.ndarray,
    outlines: list[Outline],
    z: float,
    T: Pose,
    lens: PinholeCamera,
    level: float,
) -> None:
    for outline in outlines:
        p, _ = outline.sample(0.0004)
        order = _around(p)
        q = np.column_stack([p[order], np.full(len(p), z)]) @ T[:3, :3].T + T[:3, 3]
        pixels = (lens.project(q) + 0.5) * FINE - 0.5
        cv2.fillPoly(picture, [np.round(16 * pixels).astype(np.int32)], level, shift=4)


def _around(p: Floats) -> np.ndarray:
    middle = p.mean(axis=0)
    return np.argsort(np.arctan2(p[:, 1] - middle[1], p[:, 0] - middle[0]))
