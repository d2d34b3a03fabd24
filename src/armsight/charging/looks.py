"""A picture made ready for edges to be looked for in it: gradients of the part that matters."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32, Pose, SignedShorts
from armsight.geometry.camera import PinholeCamera

SMOOTHING = 0.8
"""Standard deviation of the blur before gradients are taken [px]."""


@dataclass(frozen=True)
class Look:
    """One picture of a port.

    Attributes:
        gx: (h, w) gradient along x [levels/px]; gy: along y.
        lens: of this part of the picture.
        T_lens_ref: the reference frame (the left camera's, say) in this lens's frame.
        noise: standard deviation of the gradient where there is nothing to see [levels/px].
    """

    gx: Floats32
    gy: Floats32
    lens: PinholeCamera
    T_lens_ref: Pose
    noise: float


def gradients(image: Bytes | Floats32, smoothing: float = SMOOTHING) -> tuple[Floats32, Floats32]:
    """(h, w) gradients along x and y [levels/px] of a grey picture."""
    soft = np.asarray(image, np.float32)
    if smoothing > 0:
        soft = np.asarray(cv2.GaussianBlur(soft, (0, 0), smoothing), np.float32)
    gx = cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    gy = cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(gx, np.float32), np.asarray(gy, np.float32)


def noise_of(gx: Floats32 | SignedShorts, gy: Floats32 | SignedShorts) -> float:
    """Standard deviation of gradients in the quieter half of a picture, in their own unit.

    Half of the pixels hold no edge; for a Rayleigh distribution the 25th percentile of all is
    about the median of that half, 1.18 standard deviations. Some rows tell of all.
    """
    each = max(1, gx.size // 20_000)
    x, y = (np.asarray(g[each // 2 :: each, ::4], np.float32) for g in (gx, gy))
    sample = (x * x + y * y).ravel()
    quarter = len(sample) // 4
    return float(np.sqrt(np.partition(sample, quarter)[quarter])) / 1.18


def look(
    image: Bytes | Floats32,
    lens: PinholeCamera,
    T_lens_ref: Pose | None = None,
    smoothing: float = SMOOTHING,
    window: tuple[int, int, int, int] | None = None,
) -> Look:
    """A picture, or a window of it (top, bottom, left, right) [px], ready to be searched."""
    if window is not None:
        top, bottom, left, right = window
        image = image[top:bottom, left:right]
        lens = lens.window(top, bottom, left, right)
    gx, gy = gradients(image, smoothing)
    T = np.eye(4) if T_lens_ref is None else T_lens_ref
    return Look(gx, gy, lens, T, max(noise_of(gx, gy), 0.05))


def window_about(
    lens: PinholeCamera, T_lens_port: Pose, reach: float
) -> tuple[int, int, int, int] | None:
    """The window that shows what lies within ``reach`` [m] of a port's origin; None: not seen."""
    if T_lens_port[2, 3] < 0.05:
        return None
    u, v = lens.project(T_lens_port[None, :3, 3])[0]
    r = reach * lens.fx / T_lens_port[2, 3] + 8.0
    top, bottom = max(0, int(v - r)), min(lens.height, int(v + r) + 1)
    left, right = max(0, int(u - r)), min(lens.width, int(u + r) + 1)
    return (top, bottom, left, right) if bottom - top > 24 and right - left > 24 else None
