"""Boards that a folder itself describes: ROS-Industrial's ``cal_data.yaml``, Kalibr's target."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armsight.calibration.boards import Board, CharucoBoard, Checkerboard, CircleGrid, TagGrid
from armsight.calibration.layouts.structured import read_yaml
from armsight.errors import CalibrationError

_DICTIONARIES = (
    *(f"DICT_{n}X{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    *("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_16H5", "DICT_APRILTAG_25H9", "DICT_APRILTAG_36H10"),
    "DICT_APRILTAG_36H11",
)
"""OpenCV's order."""


def board_of(files: Sequence[Path]) -> Board | None:
    """The board that one of a folder's files describes, or None."""
    for file in files:
        if file.suffix.lower() not in (".yaml", ".yml") or file.stat().st_size > 100_000:
            continue
        try:
            document = read_yaml(file)
        except CalibrationError:
            continue
        if not isinstance(document, dict):
            continue
        try:
            board = _industrial(document.get("target_finder")) or _kalibr(document)
        except (KeyError, ValueError, IndexError, TypeError):
            raise CalibrationError(f"{file}: its board is described incompletely") from None
        if board is not None:
            return board
    return None


def _industrial(finder: Any) -> Board | None:
    if not isinstance(finder, dict):
        return None
    kind = str(finder.get("type", ""))
    if kind.startswith("Charuco"):
        return CharucoBoard(
            int(finder["cols"]),
            int(finder["rows"]),
            float(finder["chessboard_dim"]),
            float(finder["aruco_marker_dim"]),
            _DICTIONARIES[int(finder.get("dictionary", 10))],
        )
    if kind.startswith("Checkerboard"):
        return Checkerboard(
            int(finder["cols"]) + 1, int(finder["rows"]) + 1, float(finder["square"]), False
        )
    return None


def _kalibr(document: dict[str, Any]) -> Board | None:
    kind = str(document.get("target_type", "")).lower()
    columns, rows = int(document.get("targetCols", 0)), int(document.get("targetRows", 0))
    if kind == "aprilgrid":
        return TagGrid(
            columns, rows, float(document["tagSize"]), float(document["tagSpacing"]), kalibr=True
        )
    if kind == "checkerboard":
        return Checkerboard(
            columns + 1, rows + 1, float(document["rowSpacingMeters"]), hollow=False
        )
    if kind == "circlegrid":
        step = float(document["spacingMeters"])
        return CircleGrid(columns, rows, step, 0.5 * step, bool(document.get("asymmetricGrid")))
    return None
