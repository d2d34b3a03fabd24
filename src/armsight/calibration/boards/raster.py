"""A board's print as an image."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes
from armsight.calibration.boards.base import Board


def raster(board: Board, per_meter: float, margin: float) -> tuple[Bytes, float, float]:
    """The print as an image: (h, w) uint8, and x, y of its first pixel's outer corner [m].

    Args:
        board: which.
        per_meter: pixels a metre.
        margin: white rim about it [m].
    """
    x0, y0, x1, y1 = board.outline
    x0, y0, x1, y1 = x0 - margin, y0 - margin, x1 + margin, y1 + margin
    image = np.full((round((y1 - y0) * per_meter), round((x1 - x0) * per_meter)), 255, np.uint8)
    for tile in board.tiles():
        u0, u1 = (tile.x0 - x0) * per_meter, (tile.x1 - x0) * per_meter
        v0, v1 = (tile.y0 - y0) * per_meter, (tile.y1 - y0) * per_meter
        value = 0 if tile.dark else 255
        if tile.round:  # sixteenths of a pixel; pixel centres count from 0
            middle = (round((0.5 * (u0 + u1) - 0.5) * 16), round((0.5 * (v0 + v1) - 0.5) * 16))
            axes = (round(0.5 * (u1 - u0) * 16), round(0.5 * (v1 - v0) * 16))
            cv2.ellipse(image, middle, axes, 0, 0, 360, value, -1, cv2.LINE_AA, 4)
        else:
            image[round(v0) : round(v1), round(u0) : round(u1)] = value
    return image, x0, y0
