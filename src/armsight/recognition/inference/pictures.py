"""Pictures and videos from outside, as 8-bit RGB, or one line that says what is wrong with them."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from armsight.arrays import ColorImage
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.pictures import read_picture as read_bits
from armsight.recognition.inference.exif import exif_camera

PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".gif", ".bmp", ".tif", ".tiff")
VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm", ".m4v")
UNREAD = (".heic", ".heif", ".avif", ".jxl", ".jp2", ".dng", ".cr2", ".cr3", ".nef", ".arw")
"""Endings of pictures that are not read: they are said, not passed over."""
_FORMATS = ("JPEG", "PNG", "WEBP", "GIF", "BMP", "TIFF")
_OF_SEVERAL = ("PNG", "WEBP", "GIF", "TIFF")
"""Formats whose files hold films or pages. A JPEG's second picture is its camera's own business."""
_HEIF = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1", b"avif", b"avis")
_MOST_PIXELS = 64_000_000
_SMALLEST_SIDE = 32
_LONGEST_SHAPE = 8.0
_WRITTEN = (".recognised.png", ".recognised.mp4", ".mask.png")
"""What ``armsight recognise --out`` leaves: no pictures to look at."""
_WHITE = 99.5
"""Percentile of a deep picture's values above 0 that becomes white: single hot pixels, and the 0 or
infinity of depth that was not measured, decide nothing."""
_ORIENTATION = 0x0112
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""What makes a picture of each orientation of EXIF upright."""
_PILLOW = (
    OSError, ValueError, SyntaxError, EOFError, TypeError, LookupError, AttributeError,
    ArithmeticError, struct.error,
)  # fmt: skip
"""What Pillow says of damaged files: OSError of truncated data, SyntaxError of a broken PNG, the
others of tags that are not what their numbers promise."""


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        name: of its file, with the frame's number where it is of a video.
        image: (h, w, 3) RGB, upright.
        notes: what had to be done to it.
        camera: by what its file says of its lens, or None.
        orientation: as EXIF has it, of the picture as it lay in its file: 1 was upright, 6 had to
            be turned clockwise, 8 the other way.
    """

    name: str
    image: ColorImage
    notes: tuple[str, ...] = ()
    camera: PinholeCamera | None = None
    orientation: int = 1


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
                halved, count = _is_halved(opened), _pictures_of(opened)
                opened.load()
                upright = _deep_colour(file, opened) if halved else opened
                notes = _notes(opened, upright is not opened, count)
                orientation = _orientation(opened)
                turn = _TURNS.get(orientation)
                image = _as_rgb(upright if turn is None else upright.transpose(turn))
                camera = exif_camera(opened, image.shape[1], image.shape[0])
    except FileNotFoundError:
        raise RecognitionError(f"{file}: there is no such file") from None
    except UnidentifiedImageError:
        raise RecognitionError(f"{file}: {_unidentified(file)}") from None
    except Image.DecompressionBombError:
        raise RecognitionError(f"{file}: is far too large; shrink it to 4000 px or so") from None
    except _PILLOW as error:
        # What Pillow finds wrong has no number; what the file system does has one.
        if isinstance(error, OSError) and error.errno:
            raise RecognitionError(f"{file}: cannot be read ({error.strerror})") from None
        raise RecognitionError(f"{file}: is truncated or damaged ({error})") from None
    return Picture(file.name, image, notes, camera, orientation)


def pictures_in(path: Path) -> list[Path]:
    """The pictures of a folder, by name; a file itself.

    Hidden files, and what an earlier run has drawn into the folder, are none of them.

    Raises:
        RecognitionError: there is nothing, or no picture in the folder.
    """
    if path.is_dir():
        found = sorted(p for p in path.iterdir() if _is_picture(p.name) and p.is_file())
        if not found:
            unread = left_out(path)
            words = f"; {unread}" if unread else ""
            raise RecognitionError(f"{path}: has no picture ({', '.join(PICTURES)}){words}")
        return found
    if not path.exists():
        raise RecognitionError(f"{path}: there is no such file or folder")
    return [path]


def left_out(folder: Path) -> str:
    """What of a folder is no picture that is read though it looks like one, in words, or ""."""
    names = [p.name.lower() for p in folder.iterdir()]
    ends = [Path(n).suffix for n in names if not n.startswith(".") and not n.endswith(_WRITTEN)]
    count = {end: ends.count(end) for end in (*UNREAD, *VIDEOS) if end in ends}
    if not count:
        return ""
    every = ", ".join(f"{n} {end}" for end, n in count.items())
    return f"{every} left out: save pictures as JPEG or PNG, name videos one by one"


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


def _unidentified(file: Path) -> str:
    """What is wrong with a file that is no picture that can be read."""
    with file.open("rb") as opened:
        head = opened.read(12)
    if head[4:8] == b"ftyp" and head[8:] in _HEIF:
        return "is a HEIC or AVIF picture, which is not read; save it as JPEG or PNG"
    if not head:
        return "is empty"
    return f"is no picture that can be read; expected one of {', '.join(_FORMATS)}"


def _is_picture(name: str) -> bool:
    low = name.lower()
    return low.endswith(PICTURES) and not low.startswith(".") and not low.endswith(_WRITTEN)


def _orientation(image: Image.Image) -> int:
    """1 where the file does not say, or not so that it can be read: its tags are no picture.

    Pillow's own ``exif_transpose`` writes all tags anew, and fails over those that it cannot write.
    """
    try:
        said = image.getexif().get(_ORIENTATION, 1)
    except _PILLOW:
        return 1
    return said if isinstance(said, int) and said in _TURNS else 1


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


def _pictures_of(opened: Image.Image) -> int:
    """How many frames or pages a file has, as far as it can be told; before it is loaded."""
    try:
        return int(getattr(opened, "n_frames", 1)) if opened.format in _OF_SEVERAL else 1
    except _PILLOW:
        return 1


def _notes(image: Image.Image, deep: bool, count: int) -> tuple[str, ...]:
    notes = [] if count == 1 else [f"the first of {count} pictures in its file"]
    if image.mode in ("1", "L", "LA", "I", "F", "La") or image.mode.startswith("I;16"):
        notes.append("grey: the networks learned from colour")
    if deep or image.mode in ("I", "F") or image.mode.startswith("I;16"):
        notes.append("more than 8 bits: scaled so that its brightest 0.5 % are white")
    return tuple(notes)


def _as_rgb(image: Image.Image) -> ColorImage:
    if image.mode in ("I", "F") or image.mode.startswith("I;16"):
        values = np.nan_to_num(np.asarray(image, np.float64), nan=0.0, posinf=np.inf, neginf=0.0)
        white = _white(values[(values > 0) & np.isfinite(values)])
        grey = np.round(255.0 * np.clip(values / white, 0.0, 1.0)).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    return np.array(image.convert("RGB"), np.uint8)


def _white(said: NDArray[Any]) -> float:
    """The value that becomes white, of all that say something."""
    return max(float(np.percentile(said, _WHITE)) if len(said) else 0.0, 1.0)


def _is_halved(opened: Image.Image) -> bool:
    """Whether a picture that is not loaded yet has 16 bits a colour, of which Pillow keeps 8."""
    kept = opened.format in ("PNG", "TIFF") and opened.mode in ("LA", "RGB", "RGBA", "RGBX")
    return kept and any(";16" in str(tile.args) for tile in getattr(opened, "tile", ()))


def _deep_colour(file: Path, halved: Image.Image) -> Image.Image:
    """A picture of 16 bits a colour in 8, its colours scaled together; as it is if that fails.

    OpenCV reads all the bits.
    """
    values = read_bits(file, cv2.IMREAD_UNCHANGED)
    size = (halved.height, halved.width)
    if values is None or values.dtype != np.uint16 or values.shape[:2] != size or values.ndim != 3:
        return halved
    values = values[..., 2::-1]
    scale = 255.0 / _white(values[values > 0])
    table = np.round(np.minimum(scale * np.arange(2**16), 255.0)).astype(np.uint8)
    return Image.fromarray(table[values])
