"""A network's mask, brought from its cells of four pixels to the edges of the picture."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats32
from armsight.recognition.any_arm.pixel_kernels import guided

RADIUS, SMOOTH = 8, 1e-4
"""Of the filter: half its window [px], and variance of the picture that counts as none."""
ROWS, COLUMNS = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
"""Of the upper half of a symmetric matrix of three, row by row."""
EDGE = 0.45
"""Filtered probability at an arm's edge: what is thinner than a cell never fills one. Chosen on
rendered pictures of the training's renderer, as ``RADIUS`` is."""


def at_edges(arm: Floats32, image: ColorImage) -> Floats32:
    """(h, w) probability of an arm, whose step from below to above a half lies on an edge.

    The guided filter (He, Sun, Tang, TPAMI 2013, colour guide): in each window the mask is fitted
    by a linear function of the picture's colours.

    Args:
        arm: (k, k) probability by cells.
        image: (h, w, 3) that it was seen in.
    """
    h, w = image.shape[:2]
    p = cv2.resize(arm, (w, h), interpolation=cv2.INTER_LINEAR).astype(np.float32)
    guide = (cv2.GaussianBlur(image, (0, 0), 0.7) / np.float32(255)).astype(np.float32)
    slope, offset = np.empty_like(guide), np.empty_like(p)
    pairs, products = _boxed(guide[..., ROWS] * guide[..., COLUMNS]), _boxed(guide * p[..., None])
    guided(_boxed(guide), _boxed(p), pairs, products, SMOOTH, slope, offset)
    found = (_boxed(slope) * guide).sum(-1) + _boxed(offset)
    return np.asarray(np.clip(found, 0, 1) ** (np.log(0.5) / np.log(EDGE)), np.float32)


def _boxed(x: Floats32) -> Floats32:
    """Mean over the window about each pixel, channel by channel."""
    side = (2 * RADIUS + 1,) * 2
    if x.ndim == 2 or x.shape[2] <= 4:
        return cast(Floats32, cv2.blur(x, side, borderType=cv2.BORDER_REFLECT))
    parts = [cv2.blur(x[..., k : k + 3], side, borderType=cv2.BORDER_REFLECT) for k in (0, 3)]
    return np.concatenate(parts, -1)
