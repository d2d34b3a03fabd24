"""``armsight run``: any task in any cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, make_dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from armsight.commands.ending import EndsWhen
from armsight.commands.live import Working
from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.motion.task import Task
    from armsight.runtime.session import Session
    from armsight.workcell import Cell


@dataclass(frozen=True, kw_only=True)
class RunCommand(Working):
    """Run a task in a cell, guarded. The task's own options follow: run CELL --task NAME --help.

    Example: armsight run ur5_four_cameras --task patrol --dwell 1 --seconds 60 --headless

    Attributes:
        task: name of a task, or module:Class of one of your own; `patrol` comes with armsight.
    """

    task: str

    def run(self) -> int:
        """Run the task; prints how it ended."""
        from armsight.tasks.catalogue import load_options, make_task

        options = getattr(self, "task_options", None)
        if options is None:
            options = load_options(self.task)()

        return run_and_tell(self, lambda cell: make_task(self.task, options, cell))


def run_and_tell(asked: Working, make: Callable[[Cell], Task]) -> int:
    """Run the task that is made for the open cell, print how it ended; the exit code."""
    from armsight.commands.running import exit_code, ran, say, write_summary

    watch = (EndsWhen(),) if asked.headless else ()
    with ran(asked, lambda cell: (make(cell), watch)) as session:
        summary = summary_of(session)
    for key, value in summary.items():
        say(f"{key:18}{value}")
    if asked.json is not None:
        write_summary(asked.json, summary)
    return exit_code(session, asked.seconds)


def run_with(words: Sequence[str]) -> type[RunCommand]:
    """The command for the words after ``run``, with the options of the task that they name.

    Raises:
        TaskError: the task is not there, or two are asked for.
    """
    from armsight.errors import TaskError
    from armsight.tasks.catalogue import load_options, one_task

    names = list(_values(words, "--task"))
    if not names:
        return RunCommand  # says itself what it lacks
    name = one_task(names)
    options = load_options(name)
    ours = {f.name for f in fields(RunCommand)} | {f.name for f in fields(Page)}
    taken = sorted(ours & {f.name for f in fields(options) if f.init})
    if taken:
        raise TaskError(
            f"task {name}: its option {taken[0]} is one of armsight run; give it another name"
        )
    made = make_dataclass(
        "RunCommand", [("task_options", options)], bases=(RunCommand,), frozen=True, kw_only=True
    )
    made.__doc__ = f"{(options.__doc__ or RunCommand.__doc__ or name).strip()}"
    return made


def _values(words: Sequence[str], flag: str) -> Sequence[str]:
    found = [b for a, b in pairwise(words) if a == flag]
    return [*found, *(w.partition("=")[2] for w in words if w.startswith(f"{flag}="))]


def summary_of(session: Session) -> dict[str, Any]:
    """How a run ended, as JSON knows it."""
    guard, face = session.status(), session.view().face
    truth = getattr(session.cell.world, "truth", None)
    figures = {f.name: f.value for f in face.face.figures} if face is not None else {}
    return {
        "workcell": session.cell.workcell.name,
        "task": session.task.name if session.task is not None else "",
        "seed": session.seed,
        "seconds": round(session.now(), 3),
        "ended_by": session.ended_by,
        "failure": session.task_failure,
        "guard": guard.mode.value if guard is not None else "",
        "goal": guard.goal if guard is not None else "",
        "reason": guard.reason if guard is not None else "",
        "contacts": None if truth is None else len(truth.moving_contacts),
        "state": face.face.state if face is not None else "",
        "figures": {name: float(value) for name, value in figures.items() if value == value},
    }
