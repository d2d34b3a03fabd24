"""``wall-loop``: how evenly commands reach the arm under the wall clock."""

from __future__ import annotations

import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.episodes import packaged_cell, with_simulation
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armsight.workcell import Workcell

SECONDS = 20.0
"""A run of the experiment adds so much to each row [s]."""
PICTURES = 12
"""Recorded pictures a camera, played again and again."""
THREADS = 3
"""Runs of the rows with threads at most: a baseline."""
BUSY = 2
"""Processes that take all they get."""
SKIPPED = 1.0
"""Commands of the first second are not counted: devices arrive one by one [s]."""

BUDGETS = {
    "tick_ms": (10.0, 8.5),
    "tick_max_ms": (40.0, 16.0),
    "tick_busy_max_ms": (100.0, 40.0),
    "busy_goals_share": (0.5, 0.9),
}
"""Must and aim of the rows that have them."""

ABOUT = f"""
The packaged cell `ur5_four_cameras` under the wall clock, nobody in it, with arm and cameras behind
drivers as real ones are: recorded pictures of its four Kinect v2 at their 15 Hz, into which the
arm is drawn where it is (`experiments/wall_lab.py`), and an arm that notes when commands reach it.
The arm patrols; map, planner and guard do all their work. A run is {SECONDS:g} s more of one
session. Counted are the times between one command and the next, from {SKIPPED:g} s after the first
to the run's end. `busy` is the same beside {BUSY} processes that take all the processor time they
get. `threads` are the same rows with everything in one process, as before the command path had one
of its own, but with the priority that the session's threads have now.
"""


@dataclass(frozen=True)
class Window:
    """One session.

    Attributes:
        seconds: that were asked for [s]; intervals: between commands [s]; goals: reached.
        failure: what ended it too early, or empty.
        load: of the machine, processes that wanted a core in the last minute, at its end.
    """

    seconds: float
    intervals: Floats
    goals: int
    failure: str
    load: float


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` times 20 s of each row, at most a minute of the baseline's."""
    windows: dict[tuple[str, str], Window] = {}
    with tempfile.TemporaryDirectory() as folder:
        progress("recording pictures", 0.0)
        _alone(record_pictures, folder)
        for i, (where, beside) in enumerate(ROWS):
            progress(f"{where}, {beside}", (i + 0.1) / len(ROWS))
            apart = where == "process"
            seconds = SECONDS * (runs if apart else min(runs, THREADS))
            with busy(BUSY if beside == "busy" else 0):
                windows[where, beside] = _alone(patrol, folder, seconds, seed, apart)
    return Outcome(tuple(_rows(windows)), {"intervals": lambda: _plot(windows)}, _notes(windows))


ROWS = (("process", "alone"), ("process", "busy"), ("threads", "alone"), ("threads", "busy"))
"""Where the command path runs, and beside whom."""


def _alone(job: Any, *arguments: Any) -> Any:
    """Do something in a process of its own, as a command would."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context) as pool:
        return pool.submit(job, *arguments).result()


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that take all they get."""
    words = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(words) for _ in range(count)]  # noqa: S603 - fixed words
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def record_pictures(folder: str) -> None:
    """Record the pictures; module-level, so that another process can import it."""
    from armsight.experiments.wall_lab import record
    from armsight.workcell import open_cell

    workcell = _empty()
    with open_cell(workcell, 0) as cell:
        record(cell, next(iter(workcell.goals.values())), PICTURES, Path(folder))


def patrol(folder: str, seconds: float, seed: int, process: bool) -> Window:
    """Patrol for a while; module-level, so that another process can import it."""
    from armsight.errors import ArmsightError
    from armsight.experiments.wall_lab import LabArm
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.runtime.shared_block import SharedBlock
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell

    os.environ["ARMSIGHT_RUNTIME_DIR"] = folder  # its lock is nobody else's
    block = SharedBlock(size=LabArm.needs())
    arm, failure = LabArm(block), ""
    workcell = behind_drivers(_empty(), block.name, Path(folder))
    assert workcell.robot.home_deg is not None
    arm.place(np.deg2rad(workcell.robot.home_deg))
    with open_cell(workcell) as cell:
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        mode = SessionMode(cell_is_empty=True, own_process=process)
        try:
            Session(cell, task, seed=seed, mode=mode).run(seconds)
        except ArmsightError as error:
            failure = str(error)
    at = arm.commands()
    at = at[(at >= at[0] + SKIPPED) & (at < at[0] + seconds)] if len(at) else at
    arm.close()
    block.close()
    return Window(seconds, np.diff(at), task.visits, failure, os.getloadavg()[0])


def _empty() -> Workcell:
    """The cell with nobody in it, its cameras where they are believed to be."""
    return with_simulation(
        packaged_cell(), person=(), calibration_error_mm=0.0, calibration_error_deg=0.0
    )


def behind_drivers(workcell: Workcell, lab: str, folder: Path) -> Workcell:
    """The same cell with the lab's arm and cameras."""
    name, module = workcell.robot.model, "armsight.experiments.wall_lab"
    robot = workcell.robot.model_copy(
        update={"driver": f"{module}:Arm", "connection": {"lab": lab, "robot": name}}
    )
    cameras = tuple(
        section.model_copy(
            update={
                "driver": f"{module}:Camera",
                "connection": {
                    "lab": lab,
                    "pictures": str(folder),
                    "robot": name,
                    "phase": 1e-3 * section.phase_ms,
                },
            }
        )
        for section in workcell.camera
    )
    return workcell.model_copy(update={"robot": robot, "camera": cameras})


def _rows(windows: dict[tuple[str, str], Window]) -> Iterator[Row]:
    for (where, beside), window in windows.items():
        ms = 1e3 * window.intervals
        key = "tick" + ("" if where == "process" else "_threads")
        key += "_busy" if beside == "busy" else ""
        p99 = float(np.percentile(ms, 99)) if len(ms) else math.nan
        greatest = float(ms.max()) if len(ms) and not window.failure else math.nan
        for name, value, words in (
            (f"{key}_ms", p99, "from one command to the next, 99 %"),
            (f"{key}_max_ms", greatest, "from one command to the next, greatest"),
        ):
            must, aim = BUDGETS.get(name, (None, None))
            why = window.failure or "no command came"
            condition = f"{window.seconds:.0f} s, {beside}"
            yield Row(name, words, condition, value, "ms", len(ms), must=must, aim=aim, why=why)
    for where, key in (("process", "busy_goals_share"), ("threads", "busy_goals_threads_share")):
        alone, beside_others = windows[where, "alone"].goals, windows[where, "busy"].goals
        must, aim = BUDGETS.get(key, (None, None))
        yield Row(
            key,
            "goals reached beside two busy processes, of those reached alone",
            f"{beside_others} of {alone}",
            beside_others / alone if alone else math.nan,
            n=alone,
            must=must,
            aim=aim,
            better="higher",
            why="no goal was reached alone",
        )


def _notes(windows: dict[tuple[str, str], Window]) -> tuple[str, ...]:
    loads = ", ".join(f"{a} {b} {w.load:.1f}" for (a, b), w in windows.items())
    failures = [f"{a} {b}: {w.failure}" for (a, b), w in windows.items() if w.failure]
    return (
        f"Load of the machine at the end of each: {loads}.",
        *(f"Ended before its time: {failure}" for failure in failures),
    )


def _plot(windows: dict[tuple[str, str], Window]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.5))
    axes = figure.subplots()
    for (where, beside), window in windows.items():
        ms = np.sort(1e3 * window.intervals)
        if len(ms):
            longer = 1.0 - np.arange(len(ms)) / len(ms)
            axes.step(ms, longer, where="post", label=f"{where}, {beside}")
    axes.axvline(40.0, color="0.6", linewidth=0.8)
    axes.axvline(100.0, color="0.6", linewidth=0.8)
    axes.set(xscale="log", yscale="log", xlabel="ms from one command to the next")
    axes.set_ylabel("share that is longer")
    axes.legend()
    return figure


EXPERIMENT = Experiment(
    name="wall-loop",
    title="How evenly commands reach the arm under the wall clock",
    run=run,
    runs=30,
    about=ABOUT,
)
