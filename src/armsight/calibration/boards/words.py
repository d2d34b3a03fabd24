"""Boards from words such as ``checkerboard:9x6:25``."""

from __future__ import annotations

from armsight.calibration.boards.base import Board
from armsight.calibration.boards.charuco import CharucoBoard
from armsight.calibration.boards.checkerboard import Checkerboard
from armsight.calibration.boards.circles import CircleGrid
from armsight.calibration.boards.tag_grid import TagGrid
from armsight.errors import UsageError

FORMS = (
    "checkerboard:7x5:30 (squares; hollow corner where both counts are odd, unless :plain; or "
    "checkerboard:9x6:25:inner for inner corners)",
    "charuco:5x7:36:27[:DICTIONARY][:legacy]",
    "circles:7x5:30[:DIAMETER]",
    "acircles:4x11:20[:DIAMETER]",
    "apriltag:6x4:30[:GAP_SHARE[:FIRST]]",
    "aruco:4x3:40[:GAP_SHARE[:FIRST[:DICTIONARY]]]",
    "aprilgrid:6x6:88[:GAP_SHARE] (Kalibr's)",
    "tag:48:NUMBER[:DICTIONARY]",
)
"""Every form, sizes in mm."""


def parse_board(text: str) -> Board:
    """A board from words; sizes in mm, counts of squares, circles or tags across and down.

    Raises:
        UsageError: the words are not understood; lists the forms.
    """
    kind, *rest = text.strip().split(":")
    kind = kind.strip().lower()
    flags = {
        word.lower() for word in rest if word.lower() in ("plain", "inner", "legacy", "hollow")
    }
    rest = [word for word in rest if word.lower() not in flags]
    try:
        if kind == "tag":
            name = rest[2] if len(rest) > 2 else "DICT_APRILTAG_36H11"
            return TagGrid(1, 1, _mm(rest[0]), 0.0, int(rest[1]), name)
        columns, rows = (int(n) for n in rest[0].lower().split("x"))
        size = _mm(rest[1])
        if kind in ("checkerboard", "chessboard"):
            return _checkerboard(columns, rows, size, flags)
        if kind == "charuco":
            name = rest[3] if len(rest) > 3 else "DICT_6X6_250"
            return CharucoBoard(columns, rows, size, _mm(rest[2]), name, "legacy" in flags)
        if kind in ("circles", "acircles"):
            skew = kind == "acircles"
            diameter = _mm(rest[2]) if len(rest) > 2 else (0.6 if skew else 0.5) * size
            return CircleGrid(columns, rows, size, diameter, skew)
        if kind in ("apriltag", "aruco", "aprilgrid"):
            gap = float(rest[2]) if len(rest) > 2 else 0.3
            first = int(rest[3]) if len(rest) > 3 else 0
            usual = "DICT_6X6_250" if kind == "aruco" else "DICT_APRILTAG_36H11"
            name = rest[4] if len(rest) > 4 else usual
            return TagGrid(columns, rows, size, gap, first, name, kind == "aprilgrid")
    except (IndexError, ValueError):
        pass
    raise UsageError(
        f"board '{text}' is not understood; write (sizes in mm) " + ", or ".join(FORMS)
    )


def _mm(word: str) -> float:
    """Metres from millimetres; a size that no board has is not understood."""
    value = float(word)
    if not 0 < value < 1e5:
        raise UsageError(f"board: a size of {word} mm is none; sizes are in mm, up to 100 m")
    return 1e-3 * value


def _checkerboard(columns: int, rows: int, size: float, flags: set[str]) -> Checkerboard:
    if "inner" in flags:
        return Checkerboard(columns + 1, rows + 1, size, False)
    odd = columns % 2 == 1 and rows % 2 == 1
    return Checkerboard(columns, rows, size, "hollow" in flags or (odd and "plain" not in flags))
