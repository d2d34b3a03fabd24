"""Calibration boards: their corners, their look, and how to find them in an image."""

from armsight.calibration.boards.base import Board, Detection, Miss, Tile, Turn
from armsight.calibration.boards.charuco import CharucoBoard
from armsight.calibration.boards.checkerboard import Checkerboard
from armsight.calibration.boards.circles import CircleGrid
from armsight.calibration.boards.raster import raster
from armsight.calibration.boards.tag_grid import TagGrid
from armsight.calibration.boards.words import FORMS, parse_board

__all__ = [
    "FORMS",
    "Board",
    "CharucoBoard",
    "Checkerboard",
    "CircleGrid",
    "Detection",
    "Miss",
    "TagGrid",
    "Tile",
    "Turn",
    "parse_board",
    "raster",
]
