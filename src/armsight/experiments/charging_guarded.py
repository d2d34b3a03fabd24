"""Whole visits in the guarded cell, its cameras and pairs rendered, with somebody about."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from armsight.charging.station import Station
from armsight.charging.visit import State
from armsight.experiments.charging_rows import agreement_row, visit_rows
from armsight.experiments.charging_visits import (
    TYPES,
    at_the_end,
    bench_visit,
    figures,
    light_at_random,
    random_cell,
)
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.station_bench import Peaks, depth_and_tilt
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.tasks.charge import ChargeOptions, ChargeTask
from armsight.workcell import open_cell, simulated_world
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_things import PersonSection

SECONDS = 150.0
"""A visit at most [s]."""
ABOUT = """
Cars parked as in `charging`, each visited twice. *Guarded*: the whole cell with map, guard and its
rendered depth cameras and pairs, and somebody who walks up to the arm, reaches in for some seconds
and goes, again and again from a random time on. *Contact physics*, of the same cars: `charging`'s
way of counting, no guard and nobody about; the two have to agree in the share that is seated.
Seated: within 1 mm of the seat and 2 deg by the truth while the station says that it charges. Times
that begin with `waited_` (no budget) have the arm's waiting for people in them.
"""
GUARDED = "guarded, cameras rendered, somebody about"
ALONE = "contact physics, pictures searched"
Runs = list[dict[str, Any]]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` cars, each visited by the guarded cell and in contact physics; see ``ABOUT``."""
    found: dict[str, Runs] = {}
    for k, (name, visit) in enumerate((("guarded", guarded_visit), ("alone", _alone))):
        share = part_of(progress, k / 2, 1 / 2)
        found[name] = run_episodes("charging-guarded", visit, range(runs), seed, share, name)
    rows = [
        *visit_rows(found["guarded"], GUARDED, waits=True),
        *visit_rows(found["alone"], ALONE, "bench_"),
        agreement_row(found["alone"], found["guarded"], "contact physics less guarded"),
    ]
    notes = tuple(
        f"guarded, visit {i + 1}: {visit['failure'] or visit['problem'] or 'not fully in'}"
        for i, visit in enumerate(found["guarded"])
        if not visit["full"]
    )
    return Outcome(tuple(rows), notes=notes)


def _car(seed: int, i: int) -> tuple[Workcell, np.random.Generator]:
    rng = np.random.default_rng((seed, 54, i))
    return random_cell(rng, TYPES[i % len(TYPES)]), rng


def _alone(seed: int, i: int) -> dict[str, Any]:
    return bench_visit(_car(seed, i)[0], 10_000 * seed + i, rendered=True)


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


def _unended(station: Station) -> str:
    """What a visit was at when its time was over; empty when it had ended."""
    if station.outcomes:
        return ""
    return f"no end after {SECONDS:.0f} s: {station.state}, {station.words}"


def guarded_visit(seed: int, i: int) -> dict[str, Any]:
    """One visit of a car that is parked at random, with a visitor who walks in."""
    car, rng = _car(seed, i)
    workcell = visited(car, rng)
    with tempfile.TemporaryDirectory() as folder, open_cell(workcell, 10_000 * seed + i) as cell:
        light_at_random(simulated_world(cell), np.random.default_rng((10_000 * seed + i, 55)))
        task = ChargeOptions(charging=2.0, state=Path(folder) / "station.json").make(cell)
        session = Session(cell, task, seed=i, mode=SessionMode(cell_is_empty=True))
        watch = _Watch(task)
        session.observe(watch)
        session.warm_up()
        session.run(SECONDS)
        station = task.station
        outcome = station.outcomes[-1] if station.outcomes else station.outcome
        world: Any = simulated_world(cell)
        found = figures(workcell, outcome, watch.said, watch.depth, watch.tilt)
        return (
            found
            | at_the_end(world, outcome, watch.peaks, world.plugged.depth)
            | {
                "nearest_m": float(world.truth.min_distance),
                "failure": session.task_failure or _unended(station),
            }
        )


EXPERIMENT = Experiment(
    "charging-guarded", "Whole guarded visits with somebody about", run, runs=50, about=ABOUT
)
