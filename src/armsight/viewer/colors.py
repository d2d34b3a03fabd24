"""What colours mean on the page, in one place."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, ColorImage, DepthImage, Floats32
from armsight.motion.data import GuardMode

Color = tuple[int, int, int]

MODES: dict[GuardMode, tuple[str, str]] = {
    GuardMode.IDLE: ("idle", "#64748b"),
    GuardMode.PLANNING: ("planning", "#3b82f6"),
    GuardMode.PREDICTIVE: ("predictive", "#16a34a"),
    GuardMode.VELOCITY: ("velocity", "#0d9488"),
    GuardMode.SLOWED: ("slowed", "#d97706"),
    GuardMode.STOPPED: ("stopped", "#dc2626"),
    GuardMode.REFLEX: ("reflex", "#c026d3"),
}
"""Name and colour of each mode of the guard."""

PLANNED: Color = (74, 222, 128)
EXECUTED: Color = (125, 150, 190)
NEAREST: Color = (250, 204, 21)
UNSEEN: Color = (139, 92, 246)
SEEN: Color = (251, 146, 60)
THING: Color = (94, 210, 255)
"""Solid, but known to be no person."""
PERMITTED: Color = (74, 222, 128)
REFUSED: Color = (239, 68, 68)
ALIVE: Color = (45, 212, 191)
DEAD: Color = (239, 68, 68)
STATIC_OPACITY = 0.55


def _ramp(stops: list[tuple[float, Color]]) -> Bytes:
    """(256, 3) colours along stops of (position 0..1, colour)."""
    at = np.linspace(0.0, 1.0, 256)
    where = [position for position, _ in stops]
    channels = [np.interp(at, where, [color[i] for _, color in stops]) for i in range(3)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


HEIGHT = _ramp(
    [(0.0, (52, 68, 110)), (0.35, (58, 134, 160)), (0.7, (134, 205, 190)), (1.0, (240, 240, 225))]
)
"""Cloud by height: dark blue low, pale high; no red, which is kept for danger."""

_LINEAR = np.round(255.0 * (np.arange(256) / 255.0) ** 2.2).astype(np.uint8)


def for_instances(colors: Bytes) -> Bytes:
    """Viser takes the colours of instances for linear light; these look as they are meant."""
    return _LINEAR[colors]


DANGER = _ramp(
    [
        (0.0, (60, 90, 150)),
        (0.35, (75, 150, 110)),
        (0.6, (235, 185, 40)),
        (0.8, (240, 115, 35)),
        (1.0, (230, 40, 40)),
    ]
)
"""Voxels by danger: blue is long gone, red is there now."""

_GREY = np.arange(256, dtype=np.uint8)[:, None]
_TURBO: Bytes = np.array(cv2.applyColorMap(_GREY, cv2.COLORMAP_TURBO)[:, 0, ::-1], np.uint8)
_TURBO[0] = 12  # no return


def by_value(ramp: Bytes, values: Floats32, low: float, high: float) -> Bytes:
    """(n, 3) colours of (n,) values between ``low`` and ``high``."""
    scaled = (np.asarray(values, np.float32) - np.float32(low)) * np.float32(
        255.0 / max(high - low, 1e-9)
    )
    return ramp[np.clip(scaled, 0.0, 255.0).astype(np.uint8)]


def depth_picture(depth: DepthImage, width: int, nearest: float, farthest: float) -> ColorImage:
    """A small picture of a depth image: near is warm, far is cold, no return is black."""
    step = max(1, -(-depth.shape[1] // width))
    small = depth[::step, ::step]
    shade = (np.float32(farthest) - small) * np.float32(254.0 / (farthest - nearest)) + 1.0
    shade = np.where(np.isfinite(shade), np.clip(shade, 1.0, 255.0), 0.0)
    return np.asarray(_TURBO[shade.astype(np.uint8)], np.uint8)


def shrink(image: ColorImage, width: int) -> ColorImage:
    """A colour image at a width of about ``width`` pixels."""
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def fit(image: ColorImage, width: int, height: int) -> NDArray[np.uint8]:
    """An image scaled to a tile of the mosaic, bars where its shape differs."""
    scale = min(width / image.shape[1], height / image.shape[0])
    size = (max(1, int(image.shape[1] * scale)), max(1, int(image.shape[0] * scale)))
    inner = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    tile = np.full((height, width, 3), 12, np.uint8)
    top, left = (height - size[1]) // 2, (width - size[0]) // 2
    tile[top : top + size[1], left : left + size[0]] = inner
    return tile
