"""Edges of a picture at several sizes: what seeds, rings and templates are looked up in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, SignedBytes, SignedShorts
from armsight.charging.kernels.votes import edge_field
from armsight.charging.looks import noise_of

LEVELS = 5
"""Full size and four halvings."""
COUNTS = 64
"""Counts of a gradient of one level a pixel."""
STABLE = np.round(16 * 20.0 * np.sqrt(np.arange(256) + 4.0)).astype(np.int16)
"""Grey levels stretched so that noise is about as large in the dark, where black plastic is, as in
the light (shot noise grows with the root of the light); a level counts 16 at 100."""


@dataclass(frozen=True)
class Level:
    """One size of a picture.

    Attributes:
        scale: of this size against the whole: 1, 1/2, 1/4 ...
        gx, gy: (h, w) gradients, :data:`COUNTS` to a level a pixel.
        least: gradients below this say nothing [counts].
        field: (h, w, 2) of :func:`armsight.charging.kernels.votes.edge_field`.
    """

    scale: float
    gx: SignedShorts
    gy: SignedShorts
    least: float
    field: SignedBytes


def pyramid(image: Bytes, levels: int = LEVELS) -> tuple[Level, ...]:
    """All sizes of a grey picture, the finest first."""
    out = []
    # whole numbers of two bytes: what takes time here is memory
    soft = cv2.LUT(image, STABLE)
    for i in range(levels):
        if i:
            soft = cv2.pyrDown(soft)
        if min(soft.shape) < 20:
            break
        # a wider Sobel where nothing has smoothed the picture yet
        size, scale = (5, 1 / 128) if i == 0 else (3, 1 / 8)
        scale *= COUNTS / 16
        gx = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 1, 0, ksize=size, scale=scale), np.int16)
        gy = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 0, 1, ksize=size, scale=scale), np.int16)
        least = max(3.0 * noise_of(gx, gy), 0.5 * COUNTS)
        out.append(Level(0.5**i, gx, gy, least, edge_field(gx, gy, 0.7 * least)))
    return tuple(out)
