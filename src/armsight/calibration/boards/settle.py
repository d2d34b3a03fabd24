"""The board that is really there, where it is not quite the one that was named.

Squares counted for inner corners, a hollow corner missing, markers of another dictionary, columns
taken for rows: a few pictures are searched for what may have been meant, and what is taken instead
is said.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from armsight.arrays import Bytes
from armsight.calibration.boards.base import Board, Detection
from armsight.calibration.boards.charuco import CharucoBoard
from armsight.calibration.boards.checkerboard import Checkerboard
from armsight.calibration.boards.markers import dictionary
from armsight.calibration.boards.tag_grid import TagGrid
from armsight.calibration.corners import resized
from armsight.calibration.findings import Finding
from armsight.errors import UsageError

DICTIONARIES = (
    *(f"DICT_{n}X{n}_1000" for n in (4, 5, 6, 7)),
    *("DICT_APRILTAG_36h11", "DICT_APRILTAG_25h9", "DICT_APRILTAG_16h5", "DICT_APRILTAG_36h10"),
    *("DICT_ARUCO_ORIGINAL", "DICT_ARUCO_MIP_36h12"),
)
"""One of each family: the smaller ones of a family are the beginning of the largest."""


def settle_board(
    board: Board, grays: Sequence[Bytes], more: Callable[[], list[Bytes]] = list
) -> tuple[Board, list[Finding]]:
    """The board that some pictures show, and how it differs from the one that was named.

    Args:
        board: as it was named.
        grays: a few pictures.
        more: gives more of them, for a board that is in none of the few.
    """
    if not grays:
        return board, []
    if isinstance(board, Checkerboard):
        return _checkerboard(board, grays, more)
    if isinstance(board, CharucoBoard | TagGrid):
        return _marked(board, grays)
    return board, []


def _times(board: Board, grays: Sequence[Bytes]) -> int:
    return sum(isinstance(board.detect(g), Detection) for g in grays)


def _checkerboard(
    board: Checkerboard, grays: Sequence[Bytes], more: Callable[[], list[Bytes]]
) -> tuple[Board, list[Finding]]:
    """The count that is found more often wins, the larger board of those found alike."""
    plain = replace(board, hollow=False)
    inner = replace(plain, columns=board.columns + 1, rows=board.rows + 1)
    count: dict[Checkerboard, int] = {board: _times(board, grays)}
    # Part of a larger board may pass for a smaller one.
    if count[board] == len(grays) and (board.hollow or not _times(inner, grays[:1])):
        return board, []
    for other in dict.fromkeys((plain, inner)):
        count.setdefault(other, 0)
        count[other] = count[other] or _times(other, grays)
    best = max(count, key=lambda b: (count[b], b.columns, b is board))
    if count[best] == 0:
        return _another_count(board, more())
    if best == board:
        return board, []
    if best == plain and count[plain] <= count[board] + (0.5 * len(grays)):
        return board, []  # a hollow square that is unclear now and then is one all the same
    a, b = best.inner
    if best == inner:
        words = (
            f"the board has {a}x{b} inner corners: {board.columns}x{board.rows} counts corners, "
            "not squares; read so"
        )
    else:
        words = f"no corner square of the board is hollow: read as a plain one of {a}x{b} corners"
    say = f"checkerboard:{best.columns}x{best.rows}:{1e3 * best.square:g}:plain"
    return best, [Finding("board_count", "note", words, f"write --board {say}")]


ANY = (3, 3)
"""Inner corners of the smallest board that is looked for where the named one is nowhere."""
SEARCHED = 1300.0
"""Longer side of a picture that is searched for any board [px]."""


def _another_count(
    board: Checkerboard, grays: Sequence[Bytes]
) -> tuple[Checkerboard, list[Finding]]:
    """The checkerboard of another count that most pictures show in which there is any."""
    shapes: Counter[tuple[int, int]] = Counter()
    for gray in grays:
        factor = min(SEARCHED / max(gray.shape), 1.0)
        small = gray if factor == 1.0 else resized(gray, factor)
        flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
        ok, _, meta = cv2.findChessboardCornersSBWithMeta(small, ANY, flags)
        if ok and meta is not None:
            a, b = sorted(int(n) for n in np.shape(meta)[:2])
            shapes[a, b] += 1
    if not shapes:
        return board, []
    (short, long), times = shapes.most_common(1)[0]
    named = sorted(board.inner)
    if times < 2 or times < 0.5 * shapes.total() or [short, long] == named:
        return board, []
    a, b = (short, long) if board.columns <= board.rows else (long, short)
    best = replace(board, columns=a + 1, rows=b + 1, hollow=False)
    words = (
        f"no picture shows {board.inner[0]}x{board.inner[1]} inner corners, {times} of "
        f"{len(grays)} show {a}x{b}: read so"
    )
    say = f"checkerboard:{a}x{b}:{1e3 * board.square:g}:inner"
    return best, [Finding("board_count", "warning", words, f"count again, and write --board {say}")]


def _marked(board: CharucoBoard | TagGrid, grays: Sequence[Bytes]) -> tuple[Board, list[Finding]]:
    """Markers of the dictionary of which most are seen, columns and rows as they fit."""
    named = _corners(board, grays)
    if named >= 0.5 * len(grays) * min(len(board.points), 8):
        return board, []
    best, most = board, named
    for family in _families(grays):
        for turned in (False, True):
            other = _other(board, family, turned)
            if other is None or other == board:
                continue
            corners = _corners(other, grays)
            if corners > 1.5 * most + 4:
                best, most = other, corners
    if best == board:
        return board, []
    ways = []
    if best.dictionary.upper() != board.dictionary.upper():
        ways.append(f"its markers are of {best.dictionary}, not {board.dictionary}")
    if (best.columns, best.rows) != (board.columns, board.rows):
        ways.append(
            f"it is {best.columns} across and {best.rows} down, not {board.columns}x{board.rows}"
        )
    words = f"the board was named otherwise than it is seen: {' and '.join(ways)}; read so"
    return best, [Finding("board_count", "note", words, "name it so")]


def _corners(board: Board, grays: Sequence[Bytes]) -> int:
    found = [board.detect(g) for g in grays]
    return sum(len(d.corner) for d in found if isinstance(d, Detection))


def _families(grays: Sequence[Bytes]) -> list[str]:
    """Families of markers by how many of them are seen, those that are."""
    known = {k.upper(): k for k in dir(cv2.aruco)}
    count = {}
    for name in DICTIONARIES:
        if name.upper() not in known:
            continue
        detector = cv2.aruco.ArucoDetector(dictionary(name))
        seen = [detector.detectMarkers(g)[1] for g in grays]
        count[name] = sum(len(np.unique(ids)) for ids in seen if ids is not None)
    most = max(count.values(), default=0)
    return [n for n in sorted(count, key=lambda n: -count[n]) if count[n] > 0.3 * most > 0][:3]


def _other(
    board: CharucoBoard | TagGrid, family: str, turned: bool
) -> CharucoBoard | TagGrid | None:
    columns, rows = (board.rows, board.columns) if turned else (board.columns, board.rows)
    try:
        return replace(board, columns=columns, rows=rows, dictionary=family)
    except UsageError:  # the family has too few
        return None
