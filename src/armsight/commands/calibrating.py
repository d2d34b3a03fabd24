"""What the live calibrations share: nobody in the cell, and what became of the task."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.tasks.procedure_task import ProcedureTask
    from armsight.workcell import Cell

Result = TypeVar("Result")


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
