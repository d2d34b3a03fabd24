"""Directions of edges of a picture at several sizes: what seeds and templates are looked up in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32, Shorts
from armsight.charging.kernels import direction_bits
from armsight.charging.looks import gradients, noise_of

LEVELS = 5
"""Full size and four halvings."""


@dataclass(frozen=True)
class Level:
    """One size of a picture.

    Attributes:
        scale: of this size against the whole: 1, 1/2, 1/4 ...
        gx, gy: (h, w) gradients [levels/px]; size, angle: of them, 0 to 2 pi.
        least: gradients below this say nothing [levels/px].
        bits: (h, w) directions of the edges near each pixel.
    """

    scale: float
    gx: Floats32
    gy: Floats32
    size: Floats32
    angle: Floats32
    least: float
    bits: Shorts


def pyramid(image: Bytes, levels: int = LEVELS) -> tuple[Level, ...]:
    """All sizes of a grey picture, the finest first."""
    out = []
    soft = image
    for i in range(levels):
        gx, gy = gradients(soft, 1.0 if i == 0 else 0.0)
        least = max(3.0 * noise_of(gx, gy), 0.7)
        polar = cv2.cartToPolar(gx, gy)
        size, angle = (np.asarray(part, np.float32) for part in polar)
        bits = spread_bits(direction_bits(size, angle, least))
        out.append(Level(0.5**i, gx, gy, size, angle, least, bits))
        soft = np.asarray(cv2.pyrDown(soft), np.uint8)
        if min(soft.shape) < 20:
            break
    return tuple(out)


def spread_bits(bits: Shorts) -> Shorts:
    """(h, w) each pixel's bits joined with those of its eight neighbours."""
    rows = bits.copy()
    rows[:, 1:] |= bits[:, :-1]
    rows[:, :-1] |= bits[:, 1:]
    out = rows.copy()
    out[1:] |= rows[:-1]
    out[:-1] |= rows[1:]
    return out
