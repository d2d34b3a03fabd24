"""Where in each lens's picture the board will be, once that is roughly known.

A detector that searches a whole picture for a board that is not in it takes longest; most pictures
of a view have none. So later views are searched where the last answer puts the board, alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration import arm
from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.setup import Setup, Window
from armsight.calibration.views import board_in_view

LEAST_BOARDS = 3
"""A lens that saw the board less often is searched whole: nothing good is known of it."""
SLANTED = float(np.deg2rad(75))
"""A board that turns farther away than this shows no detector its corners [rad]."""
BORDER = 0.35
"""Of the board's size, about it in a window."""


def board_windows(
    setup: Setup, answer: Calibration, joints: JointVector, margin: float
) -> Mapping[int, Window | None]:
    """The window of every lens of which enough is known; None where it cannot see the board.

    Args:
        setup: what is calibrated.
        answer: the last one.
        joints: (n,) where the arm rests [rad].
        margin: how far off the prediction may be [px].
    """
    problem, state = answer.problem, answer.solution.state
    flange = arm.flange_poses(setup.robot, joints[None])
    boards = np.bincount([s.lens for s in problem.sightings], minlength=len(problem.lenses))
    out: dict[int, Window | None] = {}
    for index, lens in enumerate(problem.lenses):
        if boards[index] < LEAST_BOARDS:
            continue
        seen, pixel = board_in_view(
            problem, state, flange, index, margin=-margin, slant=SLANTED, least_square=3.0
        )
        if not seen[0]:
            out[index] = None
            continue
        low, high = pixel[0].min(0), pixel[0].max(0)
        pad = BORDER * float((high - low).max()) + 8.0 + margin
        x0, y0 = np.maximum(low - pad, 0).astype(int)
        size = [lens.camera.width, lens.camera.height]
        x1, y1 = np.minimum(np.ceil(high + pad), size).astype(int)
        out[index] = (int(x0), int(y0), int(x1), int(y1))
    return out
