"""What the live calibrations share: nobody in the cell, and what became of the task."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armsight.runtime.session import Session
    from armsight.tasks.procedure_task import ProcedureTask
    from armsight.workcell import Cell, Workcell
    from armsight.workcell.calibration_file.schema import CalibratedCamera

Result = TypeVar("Result")

WORSE = 1.25
"""A calibration is worse than another whose points are so much surer [1]."""
ELSEWHERE = 22.5
"""Squared distance of two places over their covariance that is no chance: 0.1 % of chi-squared with
six freedoms [1]."""


def nobody_inside(cell: Cell, cell_is_empty: bool) -> None:
    """Cameras that are being calibrated see nobody.

    Raises:
        CalibrationError: the cell is real, and nobody has said that it is empty.
    """
    from armsight.errors import CalibrationError

    if not (cell.simulated or cell_is_empty):
        raise CalibrationError(
            f"{cell.workcell.name}: cameras that are being calibrated protect nobody; make sure "
            "that nobody is in the cell and stays out of it, then say --cell-is-empty"
        )


def drawn_with(cell: Cell, seed: int) -> dict[str, int]:
    """What tells one simulated cell from another of its name: its errors are drawn with a seed."""
    return {"seed": seed} if cell.simulated else {}


def result_of(task: ProcedureTask[Result], session: Session) -> Result | None:
    """What a task that has ended found; None where somebody stopped it before.

    Raises:
        ArmsightError: it failed.
    """
    from armsight.errors import CalibrationError

    if task.error is not None:
        raise task.error
    if session.task_failure:
        raise CalibrationError(session.task_failure)
    return task.result


def refuse_worse(workcell: Workcell, entries: Sequence[CalibratedCamera], force: bool) -> None:
    """Keep a cell's better calibration of a camera that still stands where that says.

    A camera that stands elsewhere by both has been moved: what is new is written, however sure.

    Raises:
        CalibrationError: an entry is worse than what the cell has; nothing is to be written.
    """
    import numpy as np

    from armsight.errors import CalibrationError, WorkcellError
    from armsight.geometry.pose import inverse, log
    from armsight.workcell.calibration_file.reading import calibration_of

    try:
        old = calibration_of(workcell)
    except WorkcellError:  # of another cell, or declared elsewhere since: nothing that counts
        return
    if force or old is None:
        return
    for new in entries:
        was = old.of(new.name)
        if was is None or was.target_error is None or new.target_error is None:
            continue
        step = log(inverse(was.pose) @ new.pose)
        moved = was.mount != new.mount or step @ np.linalg.pinv(was.C + new.C) @ step > ELSEWHERE
        if new.target_error > WORSE * was.target_error and not moved:
            raise CalibrationError(
                f"{workcell.calibration_file}: {new.name} is calibrated better there (points to "
                f"{1e3 * was.target_error:.1f} mm, now {1e3 * new.target_error:.1f} mm), and "
                "stands where it did; nothing was changed: --force changes it all the same"
            )


def say(words: str) -> None:
    """One line of progress that replaces the last one on a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
    elif words:
        print(words, file=sys.stderr)
