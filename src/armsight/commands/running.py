"""Runs a session for the command line: cell, task, page, recorder, progress, summary."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from armsight.commands.live import Watching, Working
from armsight.commands.serving import Page
from armsight.errors import RecordingError, TaskError, UsageError

if TYPE_CHECKING:
    from armsight.motion.perception import Perceiver
    from armsight.motion.task import Task
    from armsight.recording.recorder import Recorder
    from armsight.runtime.component import Component
    from armsight.runtime.config import SessionConfig
    from armsight.runtime.parts import MakeParts
    from armsight.runtime.session import Session
    from armsight.workcell import Cell

console = Console(stderr=True)
INTERRUPTED = 130


@dataclass(frozen=True)
class RunOptions:
    """What a run should do.

    Attributes:
        seconds: how long on the cell's clock [s], None until interrupted.
        page: where it is served, or None for none.
        record: file to record into, or None.
        pictures: how they are recorded: `whole`, or `small`.
        seed: of everything random.
        speed: simulated seconds a second; inf as fast as possible.
        observers: more components that look on.
        cell_is_empty: somebody has looked: nobody is in the cell when it starts.
        look_only: send the arm no command at all.
        watch_robots: look for arms that no driver announces.
        make: builds map, planner and guard, where not those of a live cell.
        config: periods, latencies and configuration of the parts, where not the defaults.
    """

    seconds: float | None = None
    page: Page | None = field(default_factory=Page)
    record: Path | None = None
    pictures: Literal["small", "whole"] = "small"
    seed: int = 0
    speed: float = 1.0
    observers: Sequence[Component] = ()
    cell_is_empty: bool = False
    look_only: bool = False
    watch_robots: bool = False
    make: MakeParts | None = None
    config: SessionConfig | None = None


def run_session(cell: Cell, task: Task | None, wanted: RunOptions) -> Session:
    """Run to the end (time, Ctrl-C, SIGTERM) and return the session for its figures."""
    from armsight.runtime.config import SessionMode
    from armsight.runtime.parts import make_parts
    from armsight.runtime.session import Session
    from armsight.tasks.arm_watch import arm_watch
    from armsight.tasks.board_watch import board_watch

    watches: list[Perceiver] = []
    if wanted.make is None:
        watches += [*board_watch(cell), *arm_watch(cell)]
    if wanted.watch_robots:
        from armsight.tasks.robot_watch import robot_watch

        found = robot_watch(cell)
        if not found:
            raise UsageError("--watch-robots: no fixed camera of this cell has colour to look in")
        watches += found
    with ExitStack() as stack:
        session = Session(
            cell,
            task,
            seed=wanted.seed,
            perceivers=watches,
            observers=wanted.observers,
            mode=SessionMode(cell_is_empty=wanted.cell_is_empty, look_only=wanted.look_only),
            make=wanted.make or make_parts,
            config=wanted.config,
        )
        if wanted.record is not None:
            from armsight.recording.recorder import Recorder

            recorder = Recorder(
                wanted.record, cell, pictures=wanted.pictures, wait=not session.wall
            )
            stack.callback(_end_recording, recorder, session)
            session.observe(recorder)
        if wanted.page is not None:
            from armsight.viewer import LivePage

            page = LivePage(session, wanted.page.host, wanted.page.port, wanted.page.token)
            stack.callback(page.close)
            session.observe(page)
            say(f"live page: {page.url}   (Ctrl-C ends)")
        if cell.simulated and math.isfinite(wanted.speed):
            session.set_speed(wanted.speed)
        ticker = _Ticker(wanted.seconds)
        session.observe(ticker)
        with progress_bar() as progress:
            session.warm_up(progress)
        # With a page there is something to watch, and usually no end.
        if wanted.seconds is None or wanted.page is not None:
            session.run(wanted.seconds)
        else:
            with progress_bar() as ticker.progress:
                session.run(wanted.seconds)
    return session


def _end_recording(recorder: Recorder, session: Session) -> None:
    """A recording that ended early costs the run neither its figures nor its own reason to end."""
    try:
        file = recorder.close()
        if recorder.empty:  # interrupted while it was prepared: the name is free again
            file.unlink()
            return
        say(f"recorded {file}")
    except RecordingError as error:
        session.recording_failure = str(error)
        say(str(error))


@contextmanager
def ran(
    asked: Working,
    make: Callable[[Cell], tuple[Task, Sequence[Component]]],
) -> Iterator[Session]:
    """Open the cell, run the task in it to the end; the cell is open while figures are taken.

    Args:
        asked: by the person.
        make: the task for the open cell, and who looks on.

    Raises:
        UsageError: nobody would see when to end it.
    """
    from armsight.workcell import open_cell
    from armsight.workcell.packaged import load

    workcell, wanted = load(asked.workcell), run_options(asked)
    with open_cell(workcell, asked.seed) as cell:
        task, observers = make(cell)
        wanted = replace(
            wanted,
            observers=observers,
            cell_is_empty=asked.cell_is_empty,
            watch_robots=asked.watch_robots,
        )
        yield run_session(cell, task, wanted)


def run_options(asked: Watching) -> RunOptions:
    """What a command's options ask of a run.

    Raises:
        UsageError: nobody would see when to end it, or it would have ended before it began.
    """
    if asked.headless and asked.seconds is None:
        raise UsageError("--headless needs --seconds: nobody would see when to end it")
    if asked.seconds is not None and not asked.seconds >= 0.0:
        raise UsageError(f"--seconds is {asked.seconds:g}; expected 0 or more")
    return RunOptions(
        seconds=asked.seconds,
        page=None if asked.headless else asked.page,
        record=asked.record,
        pictures=asked.pictures,
        seed=asked.seed,
        speed=speed_of(asked.speed, asked.headless),
    )


def speed_of(given: float | None, headless: bool) -> float:
    """Wanted simulated seconds a second: real time for people, as fast as possible otherwise."""
    if given is None:
        return math.inf if headless else 1.0
    return math.inf if given == 0 else given


def exit_code(session: Session, seconds: float | None) -> int:
    """What a run ends with, once its figures have been told.

    Returns:
        1 if its recording ended early (that has been said); 130 when a run that had an end of its
        own was interrupted before it; else 0.

    Raises:
        TaskError: the task failed.
    """
    if session.task_failure:
        raise TaskError(session.task_failure)
    if session.recording_failure:
        return 1
    return INTERRUPTED if seconds is not None and session.ended_by != "time" else 0


class _Ticker:
    """Tells the progress bar how far a run is."""

    name = "progress"
    period = 0.5

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._begin: float | None = None
        self.progress: Callable[[str, float], None] = lambda stage, done: None

    def update(self, now: float) -> None:
        if self._seconds is None:
            self.progress(f"{now:.0f} s", 0.0)
            return
        # A real cell's clock runs while it is prepared, and a reset turns a simulated one back.
        if self._begin is None or now < self._begin:
            self._begin = now
        done = now - self._begin
        share = min(1.0, done / self._seconds) if self._seconds > 0.0 else 1.0
        self.progress(f"{done:.0f} of {self._seconds:g} s", share)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar on stderr for ``progress(stage, share)``; lines where there is no terminal."""
    if not console.is_terminal:
        yield _lines()
        return
    words = TextColumn("{task.description}", markup=False)
    columns = (words, BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def _lines() -> Callable[[str, float], None]:
    """Progress as a line every tenth, for logs."""
    told = [-1.0]

    def tell(stage: str, done: float) -> None:
        if done - told[0] >= 0.1 or (done >= 1.0 > told[0]):
            told[0] = done
            say(f"  {100 * done:3.0f} %  {stage}")

    return tell


def say(text: str) -> None:
    """One line to the person, on stderr; stdout is for results. Brackets are what they are."""
    console.print(text, highlight=False, soft_wrap=True, markup=False)


def write_summary(file: Path, summary: dict[str, Any]) -> None:
    """Write figures as JSON, whole or not at all; ``-`` is stdout. What is no number is null."""
    from armsight.writing import write_text

    text = json.dumps(_as_json(summary), indent=2, allow_nan=False) + "\n"
    if str(file) == "-":
        sys.stdout.write(text)
    else:
        write_text(file, text)


def _as_json(value: Any) -> Any:
    """The same without NaN and infinity, which JSON does not know."""
    if isinstance(value, dict):
        return {key: _as_json(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
