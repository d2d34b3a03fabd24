"""From a picture of any size to a network's input, and the camera matrix that goes with it.

Pixel centres are at whole numbers, so scaling by s moves a coordinate u to s (u + 0.5) - 0.5.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats


def fit_box(columns: int, rows: int, width: int, height: int) -> tuple[int, int, int, int]:
    """Largest centred box (left, top, columns, rows) with the shape of width x height [px]."""
    if columns * height > rows * width:
        kept = max(1, round(rows * width / height))
        return (columns - kept) // 2, 0, kept, rows
    kept = max(1, round(columns * height / width))
    return 0, (rows - kept) // 2, columns, kept


def fit(image: Bytes, width: int, height: int) -> Bytes:
    """(height, width[, 3]) of an image of any size: centre cut to shape, then scaled by area."""
    rows, columns = image.shape[:2]
    left, top, w, h = fit_box(columns, rows, width, height)
    cut = image[top : top + h, left : left + w]
    if (w, h) == (width, height):
        return np.ascontiguousarray(cut)
    shrinks = w >= width and h >= height
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(cut, (width, height), interpolation=how))


def fit_K(K: Floats, columns: int, rows: int, width: int, height: int) -> Floats:
    """(3, 3) camera matrix of what :func:`fit` makes of a picture of columns x rows [px]."""
    left, top, w, h = fit_box(columns, rows, width, height)
    sx, sy = width / w, height / h
    to_fit = np.array(
        [
            [sx, 0.0, sx * (0.5 - left) - 0.5],
            [0.0, sy, sy * (0.5 - top) - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    return np.asarray(to_fit @ K)
