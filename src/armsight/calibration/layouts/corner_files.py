"""Corners that somebody else's detector has found, given instead of pictures.

Layouts: one table with columns such as ``image,corner,u,v`` (``camera``, too), also mrcal's
``corners.vnl``; a file a picture with one corner a
line (``u v``, in the board's order); JSON or YAML with a list of corners a picture.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.calibration.boards import Board, Detection
from armsight.calibration.corners import straightness
from armsight.calibration.layouts.cells import cells_of
from armsight.calibration.layouts.structured import read_document
from armsight.calibration.layouts.table import natural, ordinals, read_text
from armsight.errors import CalibrationError

NAMED = re.compile(r"corner|detect|keypoint|points2d|pixels|imagepoints", re.IGNORECASE)
_IMAGE = ("image", "picture", "file", "filename", "frame", "view", "img", "name")
_CORNER = ("corner", "id", "point", "index", "corner_id", "point_id")
_CAMERA = ("camera", "cam", "sensor", "camera_id", "cam_id")
_U = ("u", "x", "px", "col", "u_px", "x_px", "pixel_x")
_V = ("v", "y", "py", "row", "v_px", "y_px", "pixel_y")


@dataclass(frozen=True)
class CornerFile:
    """Corners by picture.

    Attributes:
        source: file or folder.
        names: of the pictures.
        detections: of each.
        size: (width, height) where the file says so, or None.
    """

    source: str
    names: tuple[str, ...]
    detections: tuple[Detection | None, ...]
    size: tuple[int, int] | None


def find_corners(files: tuple[Path, ...], board: Board) -> tuple[CornerFile | None, set[Path]]:
    """Corners among a folder's files, and the files that hold them.

    Raises:
        CalibrationError: a file of corners is not what it should be.
    """
    mine = [f for f in files if NAMED.search(f.stem) or NAMED.search(f.parent.name)]
    tables = [f for f in mine if f.suffix.lower() in (".csv", ".tsv", ".txt", ".vnl")]
    for file in tables:
        found = _table(file, board)
        if found is not None:
            return found, {file}
    for file in (f for f in mine if f.suffix.lower() in (".json", ".yaml", ".yml")):
        found = _document(file, board)
        if found is not None:
            return found, {file}
    if len(tables) >= 3:
        return _one_each(sorted(tables, key=natural), board), set(tables)
    return None, set()


def _detection(board: Board, corner: Ints, pixel: Floats, where: str) -> Detection | None:
    if len(corner) and (corner.min() < 0 or corner.max() >= len(board.points)):
        raise CalibrationError(
            f"{where}: corner {int(corner.max())} is none of the {len(board.points)} of the "
            f"{board.describe()} (counted from 0, row by row)"
        )
    good = np.isfinite(pixel).all(1)
    corner, pixel = corner[good], pixel[good]
    if len(corner) < 4:
        return None
    order = np.argsort(corner)
    corner, pixel = corner[order], pixel[order]
    flat = np.asarray(board.points[corner, :2], np.float64)
    return Detection(corner, pixel, straightness(flat, pixel))


def _size_in(text: str) -> tuple[int, int] | None:
    found = re.search(r"\b(\d{3,5})\s*[x*,]\s*(\d{3,5})\b", text[:400])
    return (int(found.group(1)), int(found.group(2))) if found else None


def _table(file: Path, board: Board) -> CornerFile | None:
    text = read_text(file)
    lines = [
        (n, line)
        for n, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    marked = re.search(r"^# *(filename\b.*)$", text, re.MULTILINE)  # mrcal's .vnl
    if marked is not None:
        lines = [(0, marked.group(1)), *lines]
    if len(lines) < 5:
        return None
    header = [c.lower() for c in cells_of(lines[0][1])]
    place = {
        what: next((header.index(n) for n in names if n in header), None)
        for what, names in (
            ("image", _IMAGE), ("corner", _CORNER), ("u", _U), ("v", _V), ("camera", _CAMERA)
        )
    }  # fmt: skip
    if place["image"] is None or place["u"] is None or place["v"] is None:
        return None
    rows: dict[str, list[tuple[int, float, float]]] = {}
    for number, line in lines[1:]:
        cells = cells_of(line)
        try:
            name = cells[place["image"]]
            if place["camera"] is not None:
                name = f"{_camera(cells[place['camera']])}/{name}"
            mine = rows.setdefault(name, [])
            if "-" in (cells[place["u"]], cells[place["v"]]):
                continue  # no board in this picture
            k = int(cells[place["corner"]]) if place["corner"] is not None else len(mine)
            mine.append((k, float(cells[place["u"]]), float(cells[place["v"]])))
        except (IndexError, ValueError):
            raise CalibrationError(
                f"{file}, line {number}: cannot be read as a corner: {line[:60]!r}"
            ) from None
    names = sorted(rows, key=lambda n: natural(Path(n)))
    found = tuple(
        _detection(
            board,
            np.array([r[0] for r in rows[n]], np.int64),
            np.array([r[1:] for r in rows[n]], float).reshape(-1, 2),
            f"{file}, picture {n}",
        )
        for n in names
    )
    return CornerFile(file.name, tuple(names), found, _size_in(text))


def _camera(word: str) -> str:
    """A camera's name: a bare number is none."""
    return f"camera{word}" if word.isdigit() else word


def _one_each(files: list[Path], board: Board) -> CornerFile | None:
    names, found = [], []
    size = None
    for file in files:
        text = read_text(file)
        size = size or _size_in("\n".join(x for x in text.splitlines() if x.startswith("#")))
        rows = []
        for line in text.splitlines():
            cells = re.findall(r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?|nan", line)
            if not line.lstrip().startswith("#") and len(cells) in (2, 3):
                rows.append([float(c) for c in cells])
        if not rows or len({len(r) for r in rows}) != 1:
            continue
        value = np.array(rows)
        if value.shape[1] == 3:
            corner, pixel = value[:, 0].astype(np.int64), value[:, 1:]
        elif len(value) == len(board.points):
            corner, pixel = np.arange(len(value)), value
        else:
            raise CalibrationError(
                f"{file}: {len(value)} corners, the {board.describe()} has {len(board.points)}"
            )
        names.append(file.name)
        found.append(_detection(board, corner, pixel, str(file)))
    if len(names) < 3:
        return None
    return CornerFile(f"{files[0].parent.name}/", tuple(names), tuple(found), size)


def _document(file: Path, board: Board) -> CornerFile | None:
    document = read_document(file)
    size: tuple[int, int] | None = None
    entries: list[tuple[str, Any]] = []
    if isinstance(document, dict):
        low = {str(k).lower(): v for k, v in document.items()}
        given = low.get("image_size") or low.get("size")
        if isinstance(given, list) and len(given) == 2:
            size = (int(given[0]), int(given[1]))
        elif {"image_width", "image_height"} <= set(low):
            size = (int(low["image_width"]), int(low["image_height"]))
        inner = next(
            (low[k] for k in ("corners", "images", "views", "detections") if k in low), None
        )
        body = inner if inner is not None else document
        entries = list(body.items()) if isinstance(body, dict) else [("", v) for v in body]
    elif isinstance(document, list):
        entries = [("", v) for v in document]
    names, found = [], []
    for number, (key, value) in enumerate(entries):
        ids: Any = None
        if isinstance(value, dict):
            key = str(next((value[k] for k in _IMAGE if k in value), key))
            ids = value.get("ids", value.get("corner_ids"))
            value = value.get("corners", value.get("pixels", value.get("points")))
        try:
            pixel = np.asarray(value, float).reshape(-1, 2)
        except (TypeError, ValueError):
            continue
        corner = np.arange(len(pixel)) if ids is None else np.asarray(ids, np.int64).ravel()
        if ids is None and len(pixel) != len(board.points):
            continue
        names.append(str(key) or str(number))
        found.append(_detection(board, corner, pixel, f"{file}, picture {key or number}"))
    if len(names) < 3:
        return None
    return CornerFile(file.name, tuple(names), tuple(found), size)


def numbers_of(names: tuple[str, ...]) -> tuple[int | None, ...]:
    """The number of each picture's name."""
    return tuple(ordinals(list(names)))
