"""Whole visits in the guarded cell, its cameras and pairs rendered, with somebody about."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from armsight.charging.visit import State
from armsight.experiments.charging_visits import TYPES, at_the_end, figures, random_cell
from armsight.experiments.station_bench import Peaks, depth_and_tilt
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.tasks.charge import ChargeOptions, ChargeTask
from armsight.workcell import open_cell
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_things import PersonSection

SECONDS = 150.0
"""A visit at most [s]."""


def visited(cell: Workcell, rng: np.random.Generator) -> Workcell:
    """A cell into which somebody walks while the arm is at work, stays for some seconds, goes."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    person = PersonSection(
        name="visitor",
        script="walk_in",
        position=(float(rng.uniform(0.30, 0.55)), 1.80 * side, 0.0),
        yaw_deg=-90.0 * side,
        period_s=16.0,
        start_s=float(rng.uniform(2.0, 12.0)),
        distance=float(rng.uniform(0.7, 0.95)),
        target=(0.55, 0.0, float(rng.uniform(0.9, 1.1))),
    )
    simulation = cell.simulation.model_copy(update={"person": (person,)})
    return cell.model_copy(update={"simulation": simulation})


class _Watch:
    """Scores a visit by the truth while it goes on, and ends it."""

    name, period = "watch", 0.008

    def __init__(self, task: ChargeTask) -> None:
        self._task = task
        self._session: Any = None
        self.said = False
        self.depth = self.tilt = float("nan")
        self.peaks = Peaks()

    def attach(self, session: Session) -> None:
        """The session to score and end."""
        self._session = session

    def update(self, now: float) -> None:
        """Look at the truth."""
        plugged, station = self._session.cell.world.plugged, self._task.station
        self.peaks = self.peaks.with_force(plugged)
        if station.state is State.CHARGE and not self.said:
            self.said, (self.depth, self.tilt) = True, depth_and_tilt(plugged)
        if station.state is State.STUCK or (station.outcomes and not station.busy):
            self._session.stop("the visit has ended")


def guarded_visit(seed: int, i: int) -> dict[str, Any]:
    """One visit of a car that is parked at random, with a visitor who walks in."""
    rng = np.random.default_rng((seed, 54, i))
    workcell = visited(random_cell(rng, TYPES[i % len(TYPES)]), rng)
    with tempfile.TemporaryDirectory() as folder, open_cell(workcell, 1000 * seed + i) as cell:
        task = ChargeOptions(charging=2.0, state=Path(folder) / "station.json").make(cell)
        session = Session(cell, task, seed=i, mode=SessionMode(cell_is_empty=True))
        watch = _Watch(task)
        session.observe(watch)
        session.warm_up()
        session.run(SECONDS)
        station = task.station
        outcome = station.outcomes[-1] if station.outcomes else station.outcome
        world: Any = cell.world
        found = figures(workcell, outcome, watch.said, watch.depth, watch.tilt)
        return (
            found
            | at_the_end(world, outcome, watch.peaks, world.plugged.depth)
            | {
                "nearest_m": float(world.truth.min_distance),
                "failure": session.task_failure or "",
            }
        )
