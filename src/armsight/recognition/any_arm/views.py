"""Crops as a virtual camera sees them that is turned on the spot, and whole pictures made small."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32, Mask, Points, Rotation3
from armsight.geometry.camera import PinholeCamera

FIRST, SIDE = 160, 192
"""Of a crop [px]: of one that only shows where the arm is, and of the one that it is measured in.
The network learned from crops of the second size, with arms of many sizes in them."""
WHOLE = 256
"""Longer side of a whole picture that the network looks at [px]."""
GREY = 127
NARROWEST = 0.01
"""Tangent of half a crop's angle, at least."""


@dataclass(frozen=True)
class Crop:
    """A square picture of a virtual camera.

    Attributes:
        image: (side, side, 3).
        R: (3, 3) ``R_camera_crop``: its axes in those of the camera that took the picture.
        f: its focal length [px]; its principal point is in its middle.
        inside: (side, side) where it lies within the picture.
    """

    image: ColorImage
    R: Rotation3
    f: float
    inside: Mask

    @property
    def side(self) -> int:
        """Its width and height [px]."""
        return len(self.image)

    @property
    def _middle(self) -> float:
        return 0.5 * (self.side - 1)

    def rays(self, pixels: Floats) -> Floats:
        """(n, 2) x / z and y / z of (n, 2) pixels of the crop."""
        return (np.asarray(pixels) - self._middle) / self.f

    def pixels(self, points: Points) -> Floats:
        """(n, 2) pixels of the crop of (n, 3) points in the camera's frame in front of it."""
        p = points @ self.R
        return np.asarray(self.f * p[:, :2] / p[:, 2:] + self._middle)

    def onto(self, other: Crop) -> Floats:
        """(3, 3) from its pixels to those of another crop of the same picture."""
        a, b = self._middle, other._middle
        back = np.array([[1.0, 0.0, -a], [0.0, 1.0, -a], [0.0, 0.0, self.f]]) / self.f
        forth = np.array([[other.f, 0.0, b], [0.0, other.f, b], [0.0, 0.0, 1.0]])
        return np.asarray(forth @ other.R.T @ self.R @ back)


def take_crop(
    image: ColorImage,
    lens: PinholeCamera,
    low: Floats,
    high: Floats,
    margin: float,
    side: int = SIDE,
) -> Crop:
    """What a camera sees that turns to a box of the picture.

    Args:
        image: the picture.
        lens: that took it.
        low: (2,) upper left corner of the box [px].
        high: (2,) lower right one.
        margin: side of the crop over the longer side of the box.
        side: of the crop [px].
    """
    x, y = np.linspace(low[0], high[0], 5), np.linspace(low[1], high[1], 5)
    edge = [(u, v) for u in x for v in (low[1], high[1])]
    edge += [(u, v) for u in (low[0], high[0]) for v in y]
    rays = lens.normalise(np.array(edge))
    rays = np.hstack([rays, np.ones((len(rays), 1))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    R = looking_along(rays.sum(axis=0))
    for _ in range(2):  # the middle of a turned box is not the turned middle
        p = rays @ R
        flat = p[:, :2] / np.maximum(p[:, 2:], 0.05)
        a, b = flat.min(axis=0), flat.max(axis=0)
        R = R @ looking_along(np.array([*(0.5 * (a + b)), 1.0]))
    p = rays @ R
    half = float(np.abs(p[:, :2] / np.maximum(p[:, 2:], 0.05)).max())
    f = 0.5 * side / max(margin * half, NARROWEST)
    seen, inside = _seen(image, lens, R, f, side)
    return Crop(seen, R, f, inside)


def _seen(
    image: ColorImage, lens: PinholeCamera, R: Rotation3, f: float, side: int
) -> tuple[ColorImage, Mask]:
    # Shrunk by area first: taking single pixels of a large picture would alias.
    share = min(1.0, 1.2 * f / lens.fx)
    if share < 0.75:
        size = (max(1, round(share * lens.width)), max(1, round(share * lens.height)))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    sx, sy = image.shape[1] / lens.width, image.shape[0] / lens.height
    line = (np.arange(side) - 0.5 * (side - 1)) / f
    x, y = np.meshgrid(line, line)
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], 1) @ R.T
    pixels = np.full((x.size, 2), -1e4)
    front = points[:, 2] > 0.05
    pixels[front] = lens.project(points[front])
    u = ((pixels[:, 0] + 0.5) * sx - 0.5).astype(np.float32).reshape(side, side)
    v = ((pixels[:, 1] + 0.5) * sy - 0.5).astype(np.float32).reshape(side, side)
    grey = (GREY, GREY, GREY)
    seen = cv2.remap(
        image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=grey
    )
    inside = (u > -0.5) & (v > -0.5) & (u < image.shape[1] - 0.5) & (v < image.shape[0] - 0.5)
    return np.asarray(seen, np.uint8), inside


@dataclass(frozen=True)
class Whole:
    """A whole picture at the network's size.

    Attributes:
        image: (h, w, 3), sides multiples of 32, grey where the picture does not reach.
        scale: its pixels over the picture's.
        inside: rows and columns that the picture fills.
    """

    image: ColorImage
    scale: float
    inside: tuple[int, int]


def take_whole(image: ColorImage, longest: int = WHOLE, grain: int = 32) -> Whole:
    """A picture made small, at its upper left corner."""
    h, w = image.shape[:2]
    scale = longest / max(h, w)
    rows, columns = max(1, round(scale * h)), max(1, round(scale * w))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, (columns, rows), interpolation=way)
    out = np.full((-(-rows // grain) * grain, -(-columns // grain) * grain, 3), GREY, np.uint8)
    out[:rows, :columns] = small
    return Whole(out, scale, (rows, columns))


def looking_along(ray: Floats) -> Rotation3:
    """(3, 3) shortest turn of the optical axis to a direction."""
    a = ray / np.linalg.norm(ray)
    if a[2] < -0.999:
        return np.diag([1.0, -1.0, -1.0])
    K = np.array([[0, 0, a[0]], [0, 0, a[1]], [-a[0], -a[1], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + a[2]))


def mask_in_picture(crop: Crop, arm: Floats32, lens: PinholeCamera) -> Floats32:
    """(h, w) a crop's (k, k) map at the picture's own size; 0 where the crop does not reach."""
    h, w = lens.height, lens.width
    # The map is smooth on this scale: worked out on a coarse grid, then made large.
    step = max(1, min(h, w) // 240)
    u, v = np.meshgrid(np.arange(0, w, step), np.arange(0, h, step))
    rays = lens.normalise(np.stack([u.ravel(), v.ravel()], 1).astype(float))
    p = np.hstack([rays, np.ones((len(rays), 1))]) @ crop.R
    p[:, 2] = np.where(p[:, 2] > 0.02, p[:, 2], np.nan)
    cells = (crop.f * p[:, :2] / p[:, 2:] + 0.5 * crop.side) * (len(arm) / crop.side) - 0.5
    at = np.nan_to_num(cells, nan=-9.0).astype(np.float32).reshape(*u.shape, 2)
    found = cv2.remap(arm, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(cv2.resize(found, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)
