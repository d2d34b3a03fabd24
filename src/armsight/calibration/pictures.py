"""Pictures of a recorded set: read, and the board found in each."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from armsight.arrays import Bytes, Floats
from armsight.calibration.boards import Board, Detection
from armsight.pictures import read_picture

LARGEST = 120_000_000
"""Pixels of a picture, at most."""
FIRST = 40
"""Pictures in none of which there is a board are enough to give up [1]."""
MOST = 400
"""Pictures of a camera that are looked at; more add nothing but time."""


@dataclass(frozen=True)
class Seen:
    """What a camera's pictures show.

    Attributes:
        names: of the pictures; detections: of each, or None; misses: why not, empty for pictures
            that were not looked at because there are more than enough.
        size: (width, height) [px].
        sharpness: (n,) steepest edges on the board over its contrast [1/px]; NaN without a board.
        digest: of each picture's bytes, empty where unread: repeated pictures are told by it.
    """

    names: tuple[str, ...]
    detections: tuple[Detection | None, ...]
    misses: tuple[str, ...]
    size: tuple[int, int] | None
    sharpness: Floats
    digest: tuple[str, ...]

    def repeated(self) -> dict[int, int]:
        """Pictures that are an earlier one again, to the last digit, and which."""
        first: dict[str, int] = {}
        out: dict[int, int] = {}
        for k, (mark, d) in enumerate(zip(self.digest, self.detections)):
            key = mark or ("" if d is None else np.round(d.pixel, 6).tobytes().hex())
            if key and first.setdefault(key, k) != k:
                out[k] = first[key]
        return out


def read_gray(file: Path) -> Bytes | str:
    """A picture in shades of grey, as the sensor saw it; or the reason why it cannot be read."""
    try:
        with Image.open(file) as header:
            width, height = header.size
    except Exception:  # Pillow raises whatever a hostile file makes it stumble over
        return "picture cannot be read"
    if width * height > LARGEST:
        return f"picture is of {width}x{height}, more than {LARGEST // 1_000_000} million pixels"
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    gray = read_picture(file, flags)
    if gray is None or gray.size == 0:
        return "picture cannot be read"
    if gray.dtype != np.uint8:  # 10 to 16 bits: stretched to what is there
        low, high = np.percentile(gray, [0.5, 99.5])
        scaled = (gray.astype(np.float32) - low) * (255.0 / max(float(high - low), 1e-9))
        gray = np.clip(scaled, 0, 255).astype(np.uint8)
    return np.asarray(gray, np.uint8)


def look(
    board: Board, files: Sequence[Path], progress: Callable[[str], None] | None = None
) -> Seen:
    """Find the board in a camera's pictures; of more than :data:`MOST`, in so many evenly spread.

    Pictures of another size than most, unreadable ones and those without a board are named.
    """
    say = progress or (lambda _: None)
    wanted = [int(k) for k in np.linspace(0, len(files) - 1, min(len(files), MOST))]
    sizes = [_size(f) for f in files]
    known = [s for s in sizes if s is not None]
    usual = max(set(known), key=known.count) if known else None
    n = len(files)
    detections: list[Detection | None] = [None] * n
    misses = [""] * n
    sharp = np.full(n, np.nan)
    digest = [""] * n
    count = len(wanted)
    spread = dict.fromkeys(wanted[int(k)] for k in np.linspace(0, count - 1, min(count, FIRST)))
    order = [*spread, *(k for k in wanted if k not in spread)]
    for turn, number in enumerate(order):
        if turn == FIRST and all(d is None for d in detections):
            for k in order[FIRST:]:
                misses[k] = f"not looked at: no board in {FIRST} others"
            break
        file, size = files[number], sizes[number]
        say(f"{file.name} ({turn + 1} of {count})")
        found: Detection | None = None
        why, sharpness, mark = "", float("nan"), ""
        gray = read_gray(file) if size is not None else "picture cannot be read"
        if isinstance(gray, str):
            why = gray
        elif (gray.shape[1], gray.shape[0]) != usual:
            why = f"picture is {gray.shape[1]}x{gray.shape[0]}, most are {_words(usual)}"
        else:
            mark = hashlib.sha1(gray.tobytes(), usedforsecurity=False).hexdigest()
            seen = board.detect(gray)
            if isinstance(seen, Detection):
                found, sharpness = seen, edge_sharpness(gray, seen.pixel)
            else:
                why = seen.reason
        detections[number], misses[number] = found, why
        sharp[number], digest[number] = sharpness, mark
    names = tuple(f.name for f in files)
    return Seen(names, tuple(detections), tuple(misses), usual, sharp, tuple(digest))


def _size(file: Path) -> tuple[int, int] | None:
    try:
        with Image.open(file) as header:
            return int(header.size[0]), int(header.size[1])
    except Exception:  # see read_gray
        return None


def _words(size: tuple[int, int] | None) -> str:
    return "unread" if size is None else f"{size[0]}x{size[1]}"


def edge_sharpness(gray: Bytes, pixel: Floats) -> float:
    """Steepest edges about a board's corners over its contrast [1/px]: falls with blur."""
    x0, y0 = np.maximum(np.floor(pixel.min(0)) - 2, 0).astype(int)
    x1, y1 = np.ceil(pixel.max(0)).astype(int) + 3
    patch = gray[y0:y1, x0:x1].astype(np.float32)
    if patch.size < 64:
        return float("nan")
    slope = np.hypot(cv2.Sobel(patch, cv2.CV_32F, 1, 0), cv2.Sobel(patch, cv2.CV_32F, 0, 1)) / 8
    low, high = np.percentile(patch, [5, 95])
    return float(np.percentile(slope, 98) / max(float(high - low), 1.0))


def some_grays(files: Sequence[Path], most: int = 3) -> list[Bytes]:
    """A few of the pictures, spread evenly, those that can be read."""
    pick = sorted({int(k) for k in np.linspace(0, len(files) - 1, min(len(files), most))})
    return [g for k in pick if not isinstance(g := read_gray(files[k]), str)]
