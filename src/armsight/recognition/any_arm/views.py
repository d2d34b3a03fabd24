"""Crops as a virtual camera sees them that is turned on the spot, and whole pictures made small."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32, Mask, Points, Rotation3
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.pixel_kernels import crop_map
from armsight.recognition.own_arm.kernels import lens_array

FIRST, SIDE = 160, 192
"""Of a crop [px]: of one that only shows where the arm is, and of the one that it is measured in.
The network learned from crops of the second size, with arms of many sizes in them."""
WHOLE = 256
"""Longer side of a whole picture that the network looks at [px]."""
GREY = 127
NARROWEST = 0.01
"""Tangent of half a crop's angle, at least."""
GRAIN = 8
"""Pixels of a mask's map for one of which its place in the crop is worked out."""
BEHIND = 0.02
"""Depth of what is behind the crop's camera: it lies far beside the crop."""


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


def zoomed(image: ColorImage, lens: PinholeCamera, crop: Crop, factor: float) -> Crop:
    """What a crop's camera sees of the picture with so many times the focal length."""
    f = factor * crop.f
    seen, inside = _seen(image, lens, crop.R, f, crop.side)
    return Crop(seen, crop.R, f, inside)


def _seen(
    image: ColorImage, lens: PinholeCamera, R: Rotation3, f: float, side: int
) -> tuple[ColorImage, Mask]:
    u, v = crop_map(np.ascontiguousarray(R), f, side, lens_array(lens))
    h, w = image.shape[:2]
    inside = (u > -0.5) & (v > -0.5) & (u < w - 0.5) & (v < h - 0.5)
    if inside.any():
        # What is seen of it, and a little more for what the pixels at its edge are mixed from.
        more = 2.0 + 2.0 * lens.fx / f
        left, right = _span(u[inside], more, w)
        top, bottom = _span(v[inside], more, h)
        part, scale = image[top:bottom, left:right], np.ones(2)
        share = min(1.0, 1.2 * f / lens.fx)
        if share < 0.75:
            # Shrunk by area first: taking single pixels of a large picture would alias.
            size = [max(1, round(share * n)) for n in (right - left, bottom - top)]
            scale = np.array(size) / [right - left, bottom - top]
            part = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
        u = ((u - left + 0.5) * scale[0] - 0.5).astype(np.float32)
        v = ((v - top + 0.5) * scale[1] - 0.5).astype(np.float32)
    else:
        part = image[:1, :1]
    grey = (GREY, GREY, GREY)
    seen = cv2.remap(part, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=grey)
    return np.asarray(seen, np.uint8), inside


def _span(at: Floats32, more: float, size: int) -> tuple[int, int]:
    """First and last but one of the pixels from the least to the greatest, and some more."""
    return max(int(at.min() - more), 0), min(int(at.max() + more) + 1, size)


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
    # The map is smooth on this scale, and where it lies is smooth on the next one: worked out on
    # coarse grids, then made large.
    step = max(1, min(h, w) // 240)
    rows, columns = -(-h // step), -(-w // step)
    grain = GRAIN * step
    # A ring of coarse pixels more, since nothing is known beyond the outermost middles.
    y, x = (grain * (np.arange(-1, -(-n // GRAIN) + 1) + 0.5) - 0.5 for n in (rows, columns))
    rays = lens.normalise(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    p = np.hstack([rays, np.ones((len(rays), 1))]) @ crop.R
    cells = crop.f * p[:, :2] / np.maximum(p[:, 2:], BEHIND) + 0.5 * crop.side
    coarse = (cells * (len(arm) / crop.side) - 0.5).astype(np.float32)
    size = (GRAIN * len(x), GRAIN * len(y))
    at = cv2.resize(coarse.reshape(len(y), len(x), 2), size)[
        GRAIN : GRAIN + rows, GRAIN : GRAIN + columns
    ]
    found = cv2.remap(arm, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    whole = cv2.resize(found, (columns * step, rows * step), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(whole[:h, :w], np.float32)
