"""Writes a video of drawings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import ColorImage
from armsight.errors import RecognitionError
from armsight.writing import replacing

_RATE = 15.0


def write_video(file: Path, frames: Iterator[ColorImage]) -> int:
    """Write frames of one size as MP4, whole or not at all; none of none. How many there were.

    Raises:
        RecognitionError: the folder or the file cannot be written.
    """
    first = next(frames, None)
    if first is None:
        return 0
    count = 0
    with replacing(file, RecognitionError) as part:
        size = (first.shape[1], first.shape[0])
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*"mp4v"), _RATE, size)
        try:
            if not writer.isOpened():
                raise RecognitionError(f"{file}: cannot be written")
            for frame in chain((first,), frames):
                writer.write(np.ascontiguousarray(frame[..., ::-1]))
                count += 1
        finally:
            writer.release()
    return count
