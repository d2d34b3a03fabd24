"""What the commands that look at pictures share: which lens took one, and drawings on disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armsight.arrays import ColorImage
    from armsight.geometry.camera import PinholeCamera
    from armsight.recognition.inference.pictures import Picture


def camera_of(
    picture: Picture, intrinsics: str | None, file: Path | None, lens: PinholeCamera | None
) -> PinholeCamera | None:
    """The camera of a picture; None where nobody says which.

    Args:
        picture: the picture.
        intrinsics: fx,fy,cx,cy as they were given.
        file: of the camera, for words.
        lens: as read from it.

    Raises:
        RecognitionError: the camera is of pictures of another shape.
    """
    from armsight.recognition.inference.intrinsics import camera_for, parse_intrinsics

    height, width = picture.image.shape[:2]
    if intrinsics is not None:
        return parse_intrinsics(intrinsics, width, height)
    if lens is not None:
        return camera_for(lens, width, height, str(file), picture.orientation)
    return picture.camera


def write_png(file: Path, image: ColorImage) -> None:
    """Write a picture, whole or not at all."""
    import io

    from PIL import Image

    from armsight.writing import write_atomically

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG")
    write_atomically(file, buffer.getvalue())
