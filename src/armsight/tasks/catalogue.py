"""Which tasks there are. Others plug in by the entry points ``armsight.tasks``, or by name.

A package declares, in its ``pyproject.toml``::

    [project.entry-points."armsight.tasks"]
    keep_above = "my_package:KeepAbove"

and ``armsight run CELL --task keep_above`` runs it; so does ``--task my_package:KeepAbove`` without
any entry point. The class is a dataclass: its fields are the task's options on the command line. It
either is the task itself (:class:`~armsight.motion.task.Task`), or it has ``make(cell)``, which
returns the task for a cell.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from difflib import get_close_matches
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armsight.errors import ArmsightError, TaskError
from armsight.motion.task import Task

if TYPE_CHECKING:
    from armsight.workcell import Cell

GROUP = "armsight.tasks"
OURS = {
    "charge": "armsight.tasks.charge:ChargeOptions",
    "patrol": "armsight.tasks.patrol:PatrolOptions",
    "servo": "armsight.tasks.servo:ServoOptions",
}
"""Tasks that come with armsight; they need no entry point, so a source tree has them too."""


def task_names() -> tuple[str, ...]:
    """Every task that can be run by its name."""
    return tuple(sorted({*OURS, *(entry.name for entry in entry_points(group=GROUP))}))


def load_options(name: str) -> type[Any]:
    """The dataclass of a task's options, by its name or as ``module:Class``.

    Raises:
        TaskError: there is none, two packages claim the name, or it cannot be loaded.
    """
    found = imported(name, f"task {name}") if ":" in name else _by_name(name)
    if not isinstance(found, type) or not is_dataclass(found):
        raise TaskError(f"task {name}: {found!r} is no dataclass; its fields would be the options")
    if not (hasattr(found, "make") or hasattr(found, "update")):
        raise TaskError(
            f"task {name}: {found.__name__} has neither update(observation), as a task, "
            "nor make(cell), which returns one"
        )
    return found


def make_task(name: str, options: Any, cell: Cell) -> Task:
    """The task of a dataclass of options, for a cell.

    Raises:
        TaskError: it cannot be made, or lacks what a task needs.
        ArmsightError: what the task itself says is wrong with its options or the cell.
    """
    try:
        task = options.make(cell) if hasattr(options, "make") else options
    except ArmsightError:
        raise
    except Exception as error:  # somebody else's code may fail in any way
        raise TaskError(f"task {name} cannot begin: {type(error).__name__}: {error}") from error
    missing = [
        part for part in ("name", "period", "subscriptions", "update") if not hasattr(task, part)
    ]
    if missing:
        raise TaskError(f"task {name}: {type(task).__name__} has no {', '.join(missing)}")
    made: Task = task
    return made


def one_task(names: Sequence[str]) -> str:
    """The one task that was asked for.

    Raises:
        TaskError: none or several; the arm can follow one.
    """
    if len(names) == 1:
        return names[0]
    if not names:
        raise TaskError(f"no task given; there are: {', '.join(task_names())}")
    raise TaskError(
        f"{len(names)} tasks given ({', '.join(names)}); a cell runs one at a time: the arm can "
        "follow one intent"
    )


def _by_name(name: str) -> Any:
    if name in OURS:
        return imported(OURS[name], f"task {name}")
    found = plugged_in(GROUP, name, f"task {name}")
    if found is None:
        near = get_close_matches(name, task_names(), 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise TaskError(
            f'unknown task "{name}"; {hint}there are: {", ".join(task_names())} '
            f"(others plug in by the entry points {GROUP}, or as module:Class)"
        )
    return found


def plugged_in(group: str, name: str, what: str) -> Any:
    """What an entry point of a group has by a name, loaded; None where there is none.

    Raises:
        TaskError: two packages offer it, or it cannot be loaded.
    """
    entries = [entry for entry in entry_points(group=group) if entry.name == name]
    targets = sorted({entry.value for entry in entries})
    if len(targets) > 1:
        raise TaskError(
            f"{what}: {len(targets)} packages offer it ({', '.join(targets)}); "
            "uninstall one, or name it as module:Class"
        )
    try:
        return entries[0].load() if entries else None
    except Exception as error:  # somebody else's package may fail in any way
        raise TaskError(
            f"{what} ({targets[0]}) cannot be loaded: {type(error).__name__}: {error}"
        ) from error


def imported(target: str, what: str) -> Any:
    """``module:Class``; modules are looked for in the present folder too."""
    module, _, attribute = target.partition(":")
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.append(here)
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except Exception as error:
        raise TaskError(f"{what} cannot be loaded: {type(error).__name__}: {error}") from error
    finally:
        if added and here in sys.path:
            sys.path.remove(here)
    return found
