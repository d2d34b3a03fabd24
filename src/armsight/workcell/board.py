"""The cell's calibration board: as declared, and as a print for the simulation.

The one place of this room that knows what boards look like (``calibration/boards``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import Pose
from armsight.calibration.boards import parse_board, raster
from armsight.errors import ArmsightError, WorkcellError
from armsight.geometry.pose import make_pose
from armsight.simulation.spec import BoardSpec, Print
from armsight.workcell.schema import Workcell

if TYPE_CHECKING:
    from armsight.calibration.boards import Board

PER_METER = 6000
"""Pixels a metre of a print in simulation: 180 a square of 30 mm."""
MARGIN = 0.02
"""White about the squares [m]."""


def board_of(workcell: Workcell) -> Board:
    """The board that the cell's file names.

    Raises:
        WorkcellError: the cell has none, or there is no such kind.
    """
    section, file = workcell.board, workcell.file or workcell.name
    if section is None:
        raise WorkcellError(f"{file}: has no [board]; say which, and where it hangs")
    try:
        return parse_board(section.kind)
    except ArmsightError as error:
        raise WorkcellError(f"{file}: board.kind: {error}") from None


def board_mount(workcell: Workcell) -> Pose:
    """``T_mount_board`` as declared: the section says where the middle of the corners is.

    Raises:
        WorkcellError: the cell has no board.
    """
    board = board_of(workcell)
    assert workcell.board is not None
    middle = 0.5 * (board.points.max(0) + board.points.min(0))
    return np.asarray(workcell.board.pose @ make_pose(None, -middle))


def board_spec(workcell: Workcell) -> BoardSpec | None:
    """The board for the simulated world; None for a cell without."""
    if workcell.board is None:
        return None
    board = board_of(workcell)
    image, x0, y0 = raster(board, PER_METER, MARGIN)
    points = board.points
    middle, half = 0.5 * (points.max(0) + points.min(0)), 0.5 * np.ptp(points, axis=0)
    printed = Print(
        image,
        x0,
        y0,
        PER_METER,
        (float(middle[0]), float(middle[1])),
        (float(half[0]), float(half[1])),
    )
    return BoardSpec(
        printed,
        workcell.board.mounted_on,
        board_mount(workcell),
        workcell.simulation.board_error,
    )
