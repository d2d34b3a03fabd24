"""``patrol-smoke``: a minute of guarded patrol with a person reaching in, the first whole chain."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, contact_row
from armsight.recording.patrol_log import PatrolLog

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS = 60.0
CELL = "ur5_four_cameras"

ABOUT = """
The packaged cell `ur5_four_cameras`: a UR5 patrols between two goals under four simulated Kinect v2
(15 Hz, noise, flying pixels, 40 ms delay, 3 mm and 0.2 deg of calibration error), and a person
reaches in about every 12 s. Everything runs through the guard. Contacts and distances are the
simulation's truth; a contact counts when the touching part of the arm was faster than 0.05 m/s.
`realtime_factor` is simulated seconds a wall second for the whole chain, on the machine named.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """Patrol for 60 simulated seconds, once a run, with seeds ``seed``, ``seed + 1``, ..."""
    from armsight.workcell import load_workcell
    from armsight.workcell.packaged import packaged

    file = packaged()[CELL]
    workcell = load_workcell(file)
    logs: list[PatrolLog] = []
    factors: list[float] = []
    for i in range(runs):
        log, factor = _one(file, seed + i, lambda s, d, i=i: progress(s, (i + d) / runs))  # type: ignore[misc]
        logs.append(log)
        factors.append(factor)
    assert workcell.simulation.person, "the cell must have a person to be kept away from"
    return Outcome(tuple(_rows(logs, factors)), {"map": lambda: _plot(logs)})


def _one(file: Path, seed: int, progress: Progress) -> tuple[PatrolLog, float]:
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import load_workcell, open_cell

    workcell = load_workcell(file)
    with open_cell(workcell, seed) as cell:
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        log = PatrolLog(cell, task)
        session = Session(
            cell,
            task,
            seed=seed,
            observers=(log, _Told(progress)),
        )
        session.warm_up(lambda stage, done: progress(stage, 0.0))
        session.run(SECONDS)
        log.freeze()
        return log, session.realtime_factor


class _Told:
    """Tells how far the patrol is."""

    name = "progress"
    period = 0.5

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def update(self, now: float) -> None:
        self._progress(f"patrol {now:.0f} of {SECONDS:.0f} s", min(1.0, now / SECONDS))


def _rows(logs: list[PatrolLog], factors: list[float]) -> list[Row]:
    n = len(logs)
    contacts = sum(log.contacts or 0 for log in logs)
    distances = [log.min_distance for log in logs]
    goals = [float(log.goals_reached) for log in logs]
    map_ms = 1e3 * np.concatenate([log.map_seconds for log in logs])
    spread = (min(factors), max(factors)) if n > 1 else (None, None)
    nearest = min(distances)
    return [
        contact_row(contacts, "anything", f"{n} x {SECONDS:.0f} s", n),
        Row(
            "realtime_factor",
            "simulated seconds a second, whole chain, least and greatest run",
            "four Kinect v2 at 15 Hz",
            float(np.median(factors)),
            "1",
            n=n,
            low=spread[0],
            high=spread[1],
            must=1.5,
            aim=2.0,
            better="higher",
        ),
        Row(
            "goals_reached",
            "goals reached in 60 s, the least of all runs",
            f"{n} x {SECONDS:.0f} s",
            min(goals),
            n=n,
            low=min(goals),
            high=max(goals),
            must=4.0,
            better="higher",
        ),
        Row(
            "min_distance_m",
            "least true distance of any part of the arm to the person",
            f"{n} x {SECONDS:.0f} s",
            nearest if math.isfinite(nearest) else math.nan,
            "m",
            n=n,
            low=nearest if math.isfinite(nearest) else None,
            high=max(distances) if math.isfinite(max(distances)) else None,
            paper=0.02,
        ),
        Row(
            "map_ms_p99",
            "99th percentile of the compute time of a map update, and its median",
            "2 cm voxels",
            float(np.percentile(map_ms, 99)),
            "ms",
            n=len(map_ms),
            low=float(np.median(map_ms)),
            high=float(np.percentile(map_ms, 99)),
            must=25.0,
            aim=12.0,
        ),
    ]


def _plot(logs: list[PatrolLog]) -> Figure:
    """Distance to the person and the guard's speed over time, first run."""
    from matplotlib.figure import Figure

    log = logs[0]
    time, distance, scale = np.array(log.trace).T
    figure = Figure(figsize=(8, 3.2))
    axes = figure.subplots()
    axes.plot(time, distance, color="tab:blue", lw=1)
    axes.set(xlabel="time [s]", ylabel="distance seen by the guard [m]", ylim=(0, None))
    twin = axes.twinx()
    twin.fill_between(time, scale, color="tab:orange", alpha=0.3, lw=0)
    twin.set(ylabel="speed scale", ylim=(0, 1.05))
    for reached in log.times:
        axes.axvline(reached, color="tab:green", lw=0.8, ls=":")
    axes.set_title("patrol-smoke: distance, speed scale, goals reached (dotted)")
    return figure


EXPERIMENT = Experiment(
    name="patrol-smoke",
    title="A minute of guarded patrol, a person reaching in",
    run=run,
    runs=1,
    about=ABOUT,
)
