"""Which of a folder's pictures are views of the board, and which camera took each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from armsight.arrays import Floats
from armsight.calibration.layouts.table import natural, ordinals

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp", ".jp2")
ASIDE = re.compile(
    r"depth|mask|disp|label|seg(ment)?|result|corner|annot|overlay|debug|vis\b|undist|rectif"
    r"|detected|draw",
    re.IGNORECASE,
)
"""Words that mark pictures which are no views of the board."""
ALIKE = 0.6
"""Edges of two pictures that are so much correlated are the same view, one of them drawn on [1]."""


@dataclass(frozen=True)
class Series:
    """Pictures of one camera, in natural order.

    Attributes:
        name: of the camera, from the folder or the files' common words.
        files: the pictures.
        numbers: of each, the number that tells it from the others.
    """

    name: str
    files: tuple[Path, ...]
    numbers: tuple[int | None, ...]


def series_of(root: Path, pictures: list[Path]) -> tuple[tuple[Series, ...], tuple[Path, ...]]:
    """Series of pictures, the longest first, and pictures that are none of them.

    A folder or a pattern of names is a camera. Depth maps, masks and copies of the pictures in
    which a detector has drawn are set aside.
    """
    views = [p for p in pictures if not ASIDE.search(str(p.relative_to(root)))]
    shown = set(views)
    aside = [p for p in pictures if p not in shown]
    if not views:  # a set that happens to be called so
        views, aside = pictures, []
    groups: dict[tuple[Path, str], list[Path]] = {}
    for folder, mine in patterns(views).items():
        large = {w: files for w, files in mine.items() if len(files) >= 3}
        most = max((len(v) for v in large.values()), default=0)
        cameras = {w: v for w, v in large.items() if len(v) >= 0.6 * most}
        total = sum(len(v) for v in mine.values())
        if cameras and sum(len(v) for v in cameras.values()) >= 0.6 * total:
            for word, files in cameras.items():
                groups[folder, word] = files
            aside += [p for w, v in mine.items() if w not in cameras for p in v]
        else:  # names without a pattern
            groups[folder, ""] = [p for v in mine.values() for p in v]
    most = max((len(v) for v in groups.values()), default=0)
    kept = {k: v for k, v in groups.items() if len(v) >= 0.3 * most or len(v) >= 8}
    aside += [p for k, v in groups.items() if k not in kept for p in v]
    aside += _set_aside(kept)
    out = []
    for (folder, word), files in kept.items():
        files = sorted(files, key=natural)
        numbers = tuple(ordinals([f.name for f in files]))
        out.append(Series(_name(root, folder, word, kept), tuple(files), numbers))
    out.sort(key=lambda s: -len(s.files))
    return tuple(out), tuple(sorted(aside, key=natural))


def patterns(views: Sequence[Path]) -> dict[Path, dict[str, list[Path]]]:
    """Pictures by folder and by their names without numbers, a number that tells cameras kept.

    Pictures of the same name and several kinds (``1.jpg``, ``1.png``) are of several cameras.
    """
    out: dict[Path, dict[str, list[Path]]] = {}
    for p in views:
        word = re.sub(r"\d+", "#", p.stem.lower())
        out.setdefault(p.parent, {}).setdefault(word, []).append(p)
    for mine in out.values():
        for word, files in list(mine.items()):
            numbered = _camera_numbers(files)
            if numbered is not None:
                del mine[word]
                mine.update(numbered)
        for word, files in list(mine.items()):
            if len({p.stem.lower() for p in files}) == len(files):
                continue
            del mine[word]
            for p in files:
                mine.setdefault(f"{word}{p.suffix.lower()}", []).append(p)
    return out


MOST_CAMERAS = 8
"""Cameras that one number in the pictures' names may tell apart."""
_CAMERA_WORD = re.compile(r"(cam|camera|sensor|kinect|realsense|rs|lens|eye)[\W_]*$")


def _camera_numbers(files: Sequence[Path]) -> dict[str, list[Path]] | None:
    """Pictures of one pattern by the number that is a camera's (``cam0_12``, ``12_cam1``).

    It takes few values, and the other numbers take the same for each; None where there is none.
    """
    runs = [re.findall(r"(\D*)(\d+)", p.stem.lower()) for p in files]
    if len(runs[0]) < 2:
        return None
    best: tuple[int, int] | None = None
    for j in range(len(runs[0])):
        if _CAMERA_WORD.search(runs[0][j][0]) is None:
            continue  # as well the number of a session, or of the view
        others: dict[str, set[tuple[str, ...]]] = {}
        for run in runs:
            rest = tuple(n for k, (_, n) in enumerate(run) if k != j)
            others.setdefault(run[j][1], set()).add(rest)
        if not 2 <= len(others) <= MOST_CAMERAS:
            continue
        most = max(len(v) for v in others.values())
        if len(set.intersection(*others.values())) < max(3, 0.6 * most):
            continue
        if best is None or len(others) < best[0]:
            best = (len(others), j)
    if best is None:
        return None
    out: dict[str, list[Path]] = {}
    for file, run in zip(files, runs):
        before, number = run[best[1]]
        word = re.sub(r"[\W_]+", " ", before).strip() or "camera"
        out.setdefault(f"{word}{number}", []).append(file)
    return out


def _set_aside(groups: dict[tuple[Path, str], list[Path]]) -> list[Path]:
    """Take depth maps and drawn-on copies of other series out of the groups."""
    aside: list[Path] = []
    if len(groups) > 1:
        deep = {key: _bits(files[0]) for key, files in groups.items()}
        if set(deep.values()) == {8, 16}:
            for key in [k for k, bits in deep.items() if bits == 16]:
                aside += groups.pop(key)
    # The original has the shorter name.
    order = sorted(groups, key=lambda k: (len(k[1]), len(str(k[0]))))
    for at, key in enumerate(order):
        if any(o in groups and _same_views(groups[o], groups[key]) for o in order[:at]):
            aside += groups.pop(key)
    return aside


def _bits(file: Path) -> int:
    """Bits of a picture's channel; 8 where it cannot be read."""
    try:
        with Image.open(file) as header:
            return 16 if header.mode.startswith(("I", "F")) else 8
    except Exception:  # Pillow raises whatever a hostile file makes it stumble over
        return 8


def _same_views(first: Sequence[Path], second: Sequence[Path]) -> bool:
    """Whether two series show the same views, by the edges of some pictures of equal numbers."""
    a = dict(zip(ordinals([f.name for f in first]), first))
    b = dict(zip(ordinals([f.name for f in second]), second))
    both = sorted(k for k in a.keys() & b.keys() if k is not None)
    if len(both) < 0.6 * min(len(a), len(b)):
        return False
    pick = both[:: max(1, len(both) // 3)][:3]
    alike = [_correlation(_edges(a[k]), _edges(b[k])) > ALIKE for k in pick]
    return len(alike) > 0 and all(alike)


def _edges(file: Path) -> Floats | None:
    """(240, 320) strength of a small picture's edges; None when it cannot be read."""
    try:
        with Image.open(file) as picture:
            if picture.width * picture.height > 120_000_000:
                return None
            picture.draft("L", (640, 480))
            small = np.asarray(picture.convert("L").resize((320, 240)), np.float32)
    except Exception:  # see _bits
        return None
    return np.asarray(np.hypot(cv2.Sobel(small, -1, 1, 0), cv2.Sobel(small, -1, 0, 1)), np.float64)


def _correlation(a: Floats | None, b: Floats | None) -> float:
    if a is None or b is None:
        return 0.0
    x, y = a - a.mean(), b - b.mean()
    return float((x * y).sum() / max(float(np.sqrt((x * x).sum() * (y * y).sum())), 1e-12))


def _name(root: Path, folder: Path, word: str, groups: dict[tuple[Path, str], list[Path]]) -> str:
    """A camera's name: by its folder where cameras have folders, else by its files' words."""
    if len(groups) == 1:
        return "camera"
    alone = sum(f == folder for f, _ in groups) == 1
    if alone and folder != root:
        parts = [p for p in folder.relative_to(root).parts if p.lower() not in ("images", "data")]
        return "_".join(parts) or folder.name
    return re.sub(r"[#\W_]+", "_", word).strip("_") or folder.name
