"""Pictures of boards as a lens sees them, with their exact corners: for tests and benchmarks.

Every pixel is the mean of samples over its area, each carried through the inverse of the lens onto
the board's plane: nothing is warped by a homography, and corners are known to the last digit.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.calibration.boards import Board
from armsight.calibration.boards.raster import raster
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class Conditions:
    """How a picture is taken.

    Attributes:
        blur: sigma of the lens's blur [px]; noise: of the sensor, of 255.
        dark, light, ground: grey values of ink, paper and the room.
        glare: peak of a bright spot on the board, of 255; shade: share of the light that is
            missing at the far side.
    """

    blur: float = 0.6
    noise: float = 1.5
    dark: float = 40.0
    light: float = 190.0
    ground: float = 110.0
    glare: float = 0.0
    shade: float = 0.0


def board_picture(
    board: Board,
    camera: PinholeCamera,
    T_camera_board: Pose,
    rng: np.random.Generator,
    conditions: Conditions | None = None,
    samples: int = 4,
) -> Bytes:
    """(h, w) uint8 picture of a board in a grey room.

    Args:
        board: which.
        camera: the lens.
        T_camera_board: where the board is.
        rng: draws the noise, and where the glare is.
        conditions: light, blur and noise.
        samples: along each side of a pixel.
    """
    c = conditions or Conditions()
    seen = _clean(board, camera, T_camera_board, c, samples)
    if c.shade > 0:
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        angle = rng.uniform(-np.pi, np.pi)
        across = (u / camera.width - 0.5) * np.cos(angle) + (v / camera.height - 0.5) * np.sin(
            angle
        )
        seen = seen * (1.0 - c.shade * np.clip(across + 0.5, 0, 1))
    if c.glare > 0:
        p = corners_of(board, camera, T_camera_board)
        middle = p[rng.integers(len(p))]
        width = 0.25 * float(np.ptp(p, axis=0).max())
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        away = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / width**2
        seen = seen + c.glare * np.exp(-away)
    if c.blur > 0:
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), c.blur), np.float64)
    seen = seen + rng.normal(0, c.noise, seen.shape)
    return np.asarray(np.clip(np.rint(seen), 0, 255), np.uint8)


def corners_of(board: Board, camera: PinholeCamera, T_camera_board: Pose) -> Floats:
    """(k, 2) exact corners [px]."""
    p = board.points @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    return np.asarray(camera.project(p), np.float64)


def _clean(board: Board, camera: PinholeCamera, T: Pose, c: Conditions, samples: int) -> Floats:
    x0, y0, x1, y1 = board.outline
    margin = 0.12 * max(x1 - x0, y1 - y0)
    per_meter = 1500.0 / max(x1 - x0, y1 - y0)
    print_, left, top = raster(board, per_meter, margin)
    out: Floats = np.full((camera.height, camera.width), c.ground)
    right, bottom = left + print_.shape[1] / per_meter, top + print_.shape[0] / per_meter
    rim = np.array([[left, top], [right, top], [left, bottom], [right, bottom]])
    p = camera.project(np.column_stack([rim, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3])
    u0, v0 = np.maximum(np.floor(p.min(0)).astype(int) - 3, 0)
    u1 = min(int(np.ceil(p[:, 0].max())) + 4, camera.width)
    v1 = min(int(np.ceil(p[:, 1].max())) + 4, camera.height)
    if u1 <= u0 or v1 <= v0:
        return out
    step = (np.arange(samples) + 0.5) / samples - 0.5
    u = (np.arange(u0, u1)[:, None] + step).ravel()
    v = (np.arange(v0, v1)[:, None] + step).ravel()
    pixel = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    ray = np.column_stack([camera.normalise(pixel), np.ones(len(pixel))])
    normal, origin = T[:3, 2], T[:3, 3]
    on = ray * ((normal @ origin) / (ray @ normal))[:, None]
    flat = (on - origin) @ T[:3, :2]
    x = ((flat[:, 0] - left) * per_meter - 0.5).astype(np.float32).reshape(len(v), len(u))
    y = ((flat[:, 1] - top) * per_meter - 0.5).astype(np.float32).reshape(len(v), len(u))
    ink = print_.astype(np.float32) / 255 * (c.light - c.dark) + c.dark
    fine = cv2.remap(
        ink, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=c.ground
    )
    shape = (v1 - v0, samples, u1 - u0, samples)
    out[v0:v1, u0:u1] = fine.reshape(shape).mean(axis=(1, 3))
    return out
