"""Films for the tests of whatever reads them."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import pytest

from armsight.arrays import ColorImage


def write_film(file: Path, frames: Iterable[ColorImage]) -> None:
    """Write MJPG at 10 Hz; skips the test where this OpenCV cannot."""
    frames = list(frames)
    h, w = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10, (w, h))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPG video")
    for frame in frames:
        writer.write(frame)
    writer.release()
