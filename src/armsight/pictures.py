"""Pictures from files and messages: hostile, damaged or empty ones are None, and raise nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes


def read_picture(file: Path, flags: int) -> NDArray[Any] | None:
    """(h, w) or (h, w, c) of what OpenCV reads with these ``cv2.IMREAD_*`` flags, or None."""
    try:
        return cv2.imread(str(file), flags)
    except cv2.error:  # one that says it is larger than OpenCV reads
        return None


def decode_picture(data: bytes | Bytes, flags: int) -> NDArray[Any] | None:
    """The same of a coded picture's bytes."""
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:  # as above, and where there are no bytes at all
        return None
