"""Edges of a picture at several sizes: what seeds, rings and templates are looked up in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32
from armsight.charging.kernels.votes import edge_field
from armsight.charging.looks import noise_of

LEVELS = 5
"""Full size and four halvings."""
STABLE = (20.0 * np.sqrt(np.arange(256) + 4.0)).astype(np.float32)
"""Grey levels stretched so that noise is about as large in the dark, where black plastic is, as in
the light (shot noise grows with the root of the light); a level counts 1 at 100."""


@dataclass(frozen=True)
class Level:
    """One size of a picture.

    Attributes:
        scale: of this size against the whole: 1, 1/2, 1/4 ...
        gx, gy: (h, w) gradients [levels/px].
        least: gradients below this say nothing [levels/px].
        fx, fy: (h, w) of :func:`armsight.charging.kernels.votes.edge_field`.
    """

    scale: float
    gx: Floats32
    gy: Floats32
    least: float
    fx: Floats32
    fy: Floats32


def pyramid(image: Bytes, levels: int = LEVELS) -> tuple[Level, ...]:
    """All sizes of a grey picture, the finest first."""
    out = []
    soft = np.asarray(cv2.LUT(image, STABLE), np.float32)
    for i in range(levels):
        if i:
            soft = np.asarray(cv2.pyrDown(soft), np.float32)
        if min(soft.shape) < 20:
            break
        # a wider Sobel where nothing has smoothed the picture yet
        size, scale = (5, 1 / 128) if i == 0 else (3, 1 / 8)
        gx = np.asarray(cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=size, scale=scale), np.float32)
        gy = np.asarray(cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=size, scale=scale), np.float32)
        least = max(3.0 * noise_of(gx, gy), 0.5)
        out.append(Level(0.5**i, gx, gy, least, *edge_field(gx, gy, 0.7 * least)))
    return tuple(out)
