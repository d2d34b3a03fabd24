"""Pictures and videos from outside, as 8-bit RGB, or one line that says what is wrong with them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from armsight.arrays import ColorImage
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.inference.exif import exif_camera

PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")
VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm", ".m4v")
_FORMATS = ("JPEG", "PNG", "WEBP", "BMP", "TIFF")
_MOST_PIXELS = 64_000_000
_SMALLEST_SIDE = 32
_LONGEST_SHAPE = 8.0


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        name: of its file, with the frame's number where it is of a video.
        image: (h, w, 3) RGB, upright.
        notes: what had to be done to it.
        camera: by what its file says of its lens, or None.
    """

    name: str
    image: ColorImage
    notes: tuple[str, ...] = ()
    camera: PinholeCamera | None = None


def read_picture(file: Path) -> Picture:
    """Read a picture of 8 or 16 bits, grey or colour, turned upright as its file says.

    Raises:
        RecognitionError: it is missing, no picture, truncated, huge, tiny, or an absurd strip.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a large picture is no decompression bomb
            with Image.open(file, formats=_FORMATS) as opened:
                _check_size(str(file), *opened.size)
                opened.load()
                notes = _notes(opened)
                turned = ImageOps.exif_transpose(opened)
                image = _as_rgb(turned)
                camera = exif_camera(opened.getexif(), image.shape[1], image.shape[0])
    except FileNotFoundError:
        raise RecognitionError(f"{file}: there is no such file") from None
    except UnidentifiedImageError:
        raise RecognitionError(
            f"{file}: is no picture that can be read; expected one of {', '.join(_FORMATS)}"
        ) from None
    except Image.DecompressionBombError:
        raise RecognitionError(f"{file}: is far too large; shrink it to 4000 px or so") from None
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        # Pillow says OSError of truncated data, SyntaxError of a broken PNG.
        words = getattr(error, "strerror", None) or error
        raise RecognitionError(f"{file}: is truncated or damaged ({words})") from None
    return Picture(file.name, image, notes, camera)


def pictures_in(path: Path) -> list[Path]:
    """The pictures of a folder, by name; a file itself.

    Raises:
        RecognitionError: there is nothing, or no picture in the folder.
    """
    if path.is_dir():
        found = sorted(p for p in path.iterdir() if p.suffix.lower() in PICTURES and p.is_file())
        if not found:
            raise RecognitionError(f"{path}: has no picture ({', '.join(PICTURES)})")
        return found
    if not path.exists():
        raise RecognitionError(f"{path}: there is no such file or folder")
    return [path]


def video_frames(file: Path, every: int = 1) -> Iterator[Picture]:
    """Frames of a video, one in ``every``.

    Raises:
        RecognitionError: it cannot be read, or has no frame.
    """
    capture = cv2.VideoCapture(str(file))
    number = 0
    try:
        if not capture.isOpened():
            raise RecognitionError(f"{file}: is no video that can be read here")
        while True:
            there, frame = capture.read()
            if not there:
                break
            if number == 0:
                _check_size(str(file), frame.shape[1], frame.shape[0])
            if number % every == 0:
                yield Picture(f"{file.name}#{number}", np.ascontiguousarray(frame[..., ::-1]))
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise RecognitionError(f"{file}: is a video without a frame, or damaged")


def _check_size(name: str, width: int, height: int) -> None:
    if width * height > _MOST_PIXELS:
        raise RecognitionError(
            f"{name}: has {width} x {height} pixels, at most {_MOST_PIXELS // 10**6} million "
            "are read; shrink it"
        )
    if min(width, height) < _SMALLEST_SIDE:
        raise RecognitionError(
            f"{name}: has {width} x {height} pixels, too few to see a robot in; expected at least "
            f"{_SMALLEST_SIDE} each way"
        )
    if max(width, height) > _LONGEST_SHAPE * min(width, height):
        raise RecognitionError(
            f"{name}: is a strip of {width} x {height} pixels; cut out the part with the robot"
        )


def _notes(image: Image.Image) -> tuple[str, ...]:
    notes = []
    if image.mode in ("1", "L", "LA", "I", "F", "La") or image.mode.startswith("I;16"):
        notes.append("grey: the networks learned from colour")
    if image.mode in ("I", "F") or image.mode.startswith("I;16"):
        notes.append("more than 8 bits: scaled to its brightest value")
    return tuple(notes)


def _as_rgb(image: Image.Image) -> ColorImage:
    if image.mode in ("I", "F") or image.mode.startswith("I;16"):
        values = np.nan_to_num(np.asarray(image, np.float64))
        brightest = max(float(values.max(initial=0.0)), 1.0)
        grey = np.clip(np.round(255.0 * values / brightest), 0, 255).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    return np.array(image.convert("RGB"), np.uint8)
