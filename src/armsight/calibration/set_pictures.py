"""What the pictures of a folder show, camera by camera; or corners that are given instead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.calibration.boards import Board
from armsight.calibration.boards.settle import settle_board
from armsight.calibration.findings import Finding
from armsight.calibration.layouts.corner_files import CornerFile, find_corners, numbers_of
from armsight.calibration.layouts.folder import Folder
from armsight.calibration.layouts.lens_choice import given_lens
from armsight.calibration.layouts.series import Series, patterns
from armsight.calibration.pictures import MOST, Seen, look, some_grays
from armsight.errors import CalibrationError

LEAST = 4
"""Boards in the pictures of a camera that is worth solving."""


@dataclass(frozen=True)
class Shown:
    """What a folder's pictures show.

    Attributes:
        board: that is in them, which may not quite be the one that was named.
        series, seen: the cameras that see it, and what they see.
        files: of corners that were given instead of pictures.
        findings: what was odd.
    """

    board: Board
    series: tuple[Series, ...]
    seen: tuple[Seen, ...]
    files: frozenset[Path]
    findings: tuple[Finding, ...]


def shown_in(listed: Folder, board: Board, progress: Callable[[str], None] | None) -> Shown:
    """Find the board in a folder's pictures, or read its corners.

    Raises:
        CalibrationError: there is neither, or no picture can be read.
    """
    if not listed.series:
        return _given(listed, board)
    findings: list[Finding] = []
    files = listed.series[0].files
    board, counted = settle_board(board, some_grays(files), lambda: some_grays(files, 9))
    findings += counted
    findings += _too_many(listed.series)
    series = listed.series
    seen = tuple(look(board, s.files, progress) for s in series)
    if all(s.size is None for s in seen):
        raise CalibrationError(
            f"{listed.path}: none of {sum(len(s.names) for s in seen)} pictures can be read, such "
            f"as {series[0].files[0].name}"
        )
    series, seen, unused = _that_see_it(series, seen)
    return Shown(board, series, seen, frozenset(), (*findings, *unused))


def _given(listed: Folder, board: Board) -> Shown:
    corners, used = find_corners(listed.others, board)
    if corners is None:
        raise CalibrationError(
            f"{listed.path}: no pictures in it or in the folders below, and no file of corners"
        )
    cameras = _cameras_of(corners.names)
    series, seen = [], []
    for name, index in cameras.items():
        names = tuple(corners.names[k] for k in index)
        found = tuple(corners.detections[k] for k in index)
        size = corners.size or _size_from_lens(listed, name) or _size_from_corners(corners, index)
        misses = tuple("" if d is not None else "no corners given" for d in found)
        n = len(names)
        series.append(Series(name, tuple(Path(x) for x in names), numbers_of(names)))
        seen.append(Seen(names, found, misses, size, np.full(n, np.nan), ("",) * n))
    return Shown(board, tuple(series), tuple(seen), frozenset(used), ())


def _cameras_of(names: Sequence[str]) -> dict[str, list[int]]:
    """Pictures of each camera by their names, where these tell several cameras."""
    place = {Path(n): k for k, n in enumerate(names)}
    found: dict[str, list[int]] = {}
    for folder, words in patterns(list(place)).items():
        for word, files in words.items():
            alone = len(words) == 1 and folder != Path(".")
            name = folder.name if alone else word.strip("#_- ") or folder.name
            found.setdefault(name, []).extend(place[f] for f in files)
    most = max(len(v) for v in found.values())
    if len(found) == 1 or min(len(v) for v in found.values()) < max(LEAST, 0.3 * most):
        return {"camera": list(range(len(names)))}
    return {name: sorted(index) for name, index in found.items()}


def _size_from_lens(listed: Folder, name: str) -> tuple[int, int] | None:
    lens = given_lens(listed.others, None, name, (0, 0), 1).lens
    if lens is None or not lens.sized:
        return None
    return lens.camera.width, lens.camera.height


def _size_from_corners(corners: CornerFile, index: Sequence[int]) -> tuple[int, int]:
    found = [d for k in index if (d := corners.detections[k]) is not None]
    most = np.max([d.pixel.max(0) for d in found], axis=0) if found else np.zeros(2)
    for w, h in ((640, 480), (1280, 720), (1280, 960), (1280, 1024), (1600, 1200), (1920, 1080),
                 (1936, 1216), (2048, 1536), (2448, 2048), (3840, 2160), (4096, 3072)):  # fmt: skip
        if most[0] < w and most[1] < h:
            return w, h
    return int(most[0] * 1.05), int(most[1] * 1.05)


def _that_see_it(
    series: tuple[Series, ...], seen: tuple[Seen, ...]
) -> tuple[tuple[Series, ...], tuple[Seen, ...], list[Finding]]:
    """Cameras that see the board often enough, where some do and others do not."""
    often = [sum(d is not None for d in v.detections) >= LEAST for v in seen]
    if all(often) or not any(often):
        return series, seen, []
    keep = [k for k, enough in enumerate(often) if enough]
    unused = [
        Finding(
            "unused_camera",
            "warning",
            f"{s.name}: the board is found in {sum(d is not None for d in v.detections)} of "
            f"{len(v.names)} pictures ({', '.join(sorted({m for m in v.misses if m})[:2])}): "
            "not used",
            "leave the folder out if it shows something else",
        )
        for s, v, enough in zip(series, seen, often)
        if not enough
    ]
    return tuple(series[k] for k in keep), tuple(seen[k] for k in keep), unused


def _too_many(series: Sequence[Series]) -> list[Finding]:
    return [
        Finding(
            "many_pictures",
            "note",
            f"{s.name}: {len(s.files)} pictures, {MOST} of them evenly spread are looked at",
            "more would cost time and tell nothing new",
        )
        for s in series
        if len(s.files) > MOST
    ]
