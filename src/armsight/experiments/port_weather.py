"""What weather, dirt, lens and sensor make of a drawn picture of a port: what a renderer lacks."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32, Pose
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class Style:
    """What is laid over a picture; see :func:`weather` and :func:`expose`."""

    gain: float
    noise: float
    blur: float
    dirt: float
    wet: float
    mirror: float
    shade: float
    seed: int


def weather(gray: Floats32, lens: PinholeCamera, T_camera_port: Pose, style: Style) -> Floats32:
    """Dirt that sticks to the port's plane, drops, a mirrored sky, a straight shadow."""
    window = window_about_port(lens, T_camera_port, 0.16)
    if window is None:
        return gray
    top, bottom, left, right = window
    rng = np.random.default_rng((style.seed, 13))
    v, u = np.mgrid[top:bottom, left:right].astype(np.float32)
    rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones_like(u)], -1)
    n, origin = T_camera_port[:3, 2].astype(np.float32), T_camera_port[:3, 3].astype(np.float32)
    distance = (n @ origin) / (rays @ n)
    local = (rays * distance[..., None] - origin) @ T_camera_port[:3, :3].astype(np.float32)
    x, y = np.asarray(local[..., 0], np.float32), np.asarray(local[..., 1], np.float32)
    near = np.clip((0.15 - np.hypot(x, y)) / 0.03, 0.0, 1.0)
    out = gray.copy()
    part = out[top:bottom, left:right].copy()
    if style.dirt > 0:
        cloud = _field(rng, x, y, 0.012) + 0.6 * _field(rng, x, y, 0.004)
        dust = np.clip(cloud - 0.4, 0.0, 1.0) * style.dirt * near
        part = np.asarray(part * (1 - dust) + 95.0 * dust, np.float32)
    if style.mirror > 0:
        # The sky moves with the view, so each camera mirrors another part of it.
        shift = 0.3 * origin[0]
        part += (
            style.mirror
            * near
            * np.clip(_field(rng, np.asarray(x + shift, np.float32), y, 0.05), 0.0, 1.5)
        )
    if style.wet > 0:
        drops = _field(rng, x, y, 0.0022)
        part += near * style.wet * np.where(drops > 2.3, 40.0, 0.0)
        part -= near * style.wet * np.where(drops < -2.3, 8.0, 0.0)
    if style.shade < 1.0:
        a, offset = rng.uniform(-np.pi, np.pi), rng.uniform(-0.03, 0.03)
        side = x * np.cos(a) + y * np.sin(a) - offset
        part *= np.where(side > 0, style.shade + (1 - style.shade) * (1 - near), 1.0)
    out[top:bottom, left:right] = part
    return out


def window_about_port(
    lens: PinholeCamera, T: Pose, reach: float
) -> tuple[int, int, int, int] | None:
    """(top, bottom, left, right) [px] of what is within ``reach`` [m] of a pose; None: nothing."""
    if T[2, 3] < 0.05:
        return None
    middle = lens.project(T[None, :3, 3])[0]
    r = reach * lens.fx / T[2, 3]
    left, right = int(max(0, middle[0] - r)), int(min(lens.width, middle[0] + r))
    top, bottom = int(max(0, middle[1] - r)), int(min(lens.height, middle[1] + r))
    return (top, bottom, left, right) if right > left and bottom > top else None


def _field(rng: np.random.Generator, x: Floats32, y: Floats32, size: float) -> Floats32:
    """Smooth noise of unit variance over the plane, features about ``size`` [m] wide."""
    table = cv2.GaussianBlur(rng.standard_normal((256, 256), np.float32), (0, 0), 1.2)
    table = (table / table.std()).astype(np.float32)
    at_x, at_y = (x / np.float32(0.5 * size) + 128, y / np.float32(0.5 * size) + 128)
    return np.asarray(
        cv2.remap(table, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), np.float32
    )


def expose(gray: Floats32, style: Style, rng: np.random.Generator) -> Bytes:
    """Lens blur, exposure, shot and read noise, eight bits."""
    image = cv2.GaussianBlur(gray, (0, 0), style.blur)
    image = image * np.float32(style.gain)
    noise = rng.standard_normal(image.shape, np.float32)
    image += noise * np.sqrt(0.25 * style.noise**2 + 0.012 * np.maximum(image, 0) * style.noise)
    return np.asarray(np.clip(image + 0.5, 0, 255), np.uint8)
