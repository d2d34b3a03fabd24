"""Numbered square markers: OpenCV's dictionaries, and a marker as dark and white tiles."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.calibration.boards.base import Tile
from armsight.errors import UsageError


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """A dictionary by OpenCV's name, with or without ``DICT_``, in any case.

    Raises:
        UsageError: there is none; names those that there are.
    """
    known = {k.upper(): k for k in dir(cv2.aruco) if k.startswith("DICT_")}
    key = name.upper()
    for form in (key, f"DICT_{key}", f"DICT_APRILTAG_{key}", f"DICT_APRILTAG_{key.lstrip('T')}"):
        if form in known:
            return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known[form]))
    raise UsageError(
        f"no marker dictionary '{name}'; choose one of {', '.join(sorted(known.values()))}"
    )


def marker_tiles(
    marks: cv2.aruco.Dictionary, tag: int, x0: float, y0: float, size: float, border: int = 1
) -> list[Tile]:
    """A marker as its dark square and the white cells on it; ``border`` cells of dark rim."""
    cells = int(marks.markerSize) + 2 * border
    image = cv2.aruco.generateImageMarker(marks, tag, cells, borderBits=border)
    step = size / cells
    out = [Tile(x0, y0, x0 + size, y0 + size, True)]
    for j, i in zip(*np.nonzero(image)):
        out.append(
            Tile(x0 + i * step, y0 + j * step, x0 + (i + 1) * step, y0 + (j + 1) * step, False)
        )
    return out
