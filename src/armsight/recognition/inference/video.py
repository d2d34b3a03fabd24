"""Writes a video of drawings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import ColorImage
from armsight.errors import RecognitionError

_RATE = 15.0


def write_video(file: Path, frames: Iterator[ColorImage]) -> int:
    """Write frames of one size as MP4, whole or not at all; how many there were.

    Raises:
        RecognitionError: the folder or the file cannot be written.
    """
    part = file.with_name(f".{file.stem}.part.mp4")
    writer: cv2.VideoWriter | None = None
    count = 0
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                code = cv2.VideoWriter.fourcc(*"mp4v")
                writer = cv2.VideoWriter(str(part), code, _RATE, size)
                if not writer.isOpened():
                    raise RecognitionError(f"{file}: cannot be written")
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
            count += 1
        if writer is not None:
            writer.release()
            part.replace(file)
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be written ({error.strerror or error})") from None
    finally:
        if writer is not None:
            writer.release()
        part.unlink(missing_ok=True)
    return count
