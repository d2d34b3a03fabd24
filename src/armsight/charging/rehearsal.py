"""A port painted flat and looked for, once, before it matters.

Compiling what finds ports takes minutes on a busy machine, and a perceiver that does not return for
a minute is given up: its first picture must not be the first of the program.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from armsight.arrays import Bytes, Pose
from armsight.charging.find import FindOptions
from armsight.charging.ports.outline import Outline
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import PortPose, locate
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.geometry.stereo import converging_pair

LENS = PinholeCamera(480, 360, 600.0, 600.0, 240.0, 180.0)
WALL, FACE, DARK = 120, 60, 15
"""Grey levels."""


@cache
def rehearse() -> tuple[PortPose, ...]:
    """Run the whole chain of finding on a made-up pair of pictures; what it found."""
    pair = converging_pair(LENS, 0.1, float(np.deg2rad(10.0)))
    lean = from_rpy((np.pi, 0.0, 0.0)) @ from_rpy((0.25, 0.1, 0.0))
    T = make_pose(lean[:3, :3], (0.0, 0.0, 0.5))
    pictures = (_painted(T), _painted(inverse(pair.T_left_right) @ T))
    return locate(pictures, pair, FindOptions(("type2", "ccs2")))


def _painted(T_camera_port: Pose) -> Bytes:
    """(h, w) a Type 2 inlet on a wall."""
    picture = np.full((LENS.height, LENS.width), WALL, np.uint8)
    port = PORTS["type2"]
    _fill(picture, port.plate, T_camera_port, FACE)
    for rims, level in (
        (port.of_kind("mouth"), DARK),
        (port.of_kind("pedestal"), FACE),
        (port.of_kind("recess"), DARK),
    ):
        for rim in rims:
            _fill(picture, rim.outline, T_camera_port, level)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.uint8)


def _fill(picture: Bytes, outline: Outline, T: Pose, level: int) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    x = outline.x + outline.radius * np.cos(turn) + outline.spread * np.sign(np.cos(turn))
    y = outline.y + outline.radius * np.sin(turn)
    if outline.flat is not None:
        y = np.minimum(y, outline.flat)
    q = np.column_stack([x, y, np.zeros(len(x))]) @ T[:3, :3].T + T[:3, 3]
    cv2.fillPoly(picture, [np.round(16 * LENS.project(q)).astype(np.int32)], level, cv2.LINE_AA, 4)
