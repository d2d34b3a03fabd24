"""The station killed in every phase of a visit and started again: does the plug end safely?"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, share_row
from armsight.experiments.station_bench import StationBench, charging_cell, make_station
from armsight.experiments.station_sigkill import OUT, killed

VERSION = 8
FIRST_REAL = 10**6
"""Number of the first kill of a process, in the cache."""
ABOUT = """
In each phase of a visit, at a random moment of it, the station is killed and started again from its
file. Two ways:

* *process killed*: the session of `armsight charge ur10_charging --headless` in a process of its
  own (map, guard, rendered cameras and pairs), killed by SIGKILL; where arm, plug and car stand in
  its simulation is handed to the next process, as a real arm would stand where its watchdog stopped
  it. A tenth as many, one of each phase at least. Safe: it stands by or is on its way there, nobody
  is asked for help, the arm touched nothing but the port, and the plug is out of the car by the
  truth (more than 5 cm before its face). Home: it is at its stand-by, and its file is gone.
* *objects thrown away*: contact physics alone (`experiments/station_bench.py`: no guard, looks
  drawn from the pairs' errors); everything that the program knows is thrown away but the file.
  Safe: as above, and at home.
"""
PHASES = (
    State.FIND,
    State.LOOK,
    State.APPROACH,
    State.ALIGN,
    State.TARE,
    State.INSERT,
    State.CHARGE,
    State.UNPLUG,
    State.LEAVE,
)
LATEST = {State.FIND: 0.5, State.TARE: 0.4, State.INSERT: 3.5, State.CHARGE: 1.5}
"""A phase is killed within so long after it began [s]; 1.5 unless named."""
PATIENCE = 120.0
"""For each part of a visit [s]."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` kills in each of nine phases, and a tenth as many of the process itself."""
    cache = RunCache("station-kill", seed, {"version": VERSION})
    thrown: list[dict[str, Any]] = []
    real: list[dict[str, Any]] = []
    processes = len(PHASES) * max(1, runs // 10)
    for i in range(processes):
        progress(f"kill -9, {PHASES[i % len(PHASES)]}", 0.7 * i / processes)
        real.append(cache.get(FIRST_REAL + i, partial(_process, seed, i)))
    for i in range(runs):
        progress("objects thrown away", 0.7 + 0.3 * i / runs)
        thrown += cache.get(i, partial(_round, seed, i))["kills"]
    rows = []
    for found, how in ((real, "process killed"), (thrown, "objects thrown away")):
        for phase in PHASES:
            mine = [k for k in found if k["phase"] == phase.value]
            rows.append(_row("safe_after_kill", f"{how}: {phase.value}", mine))
        rows.append(_row("safe_after_kill", f"{how}: all phases", found))
    home = [k | {"safe": k["home"]} for k in real]
    what = "and back at the stand-by within 20 s of the new process"
    rows.append(replace(_row("home_after_kill", "process killed", home, None), measure=what))
    notes = tuple(f"not safe: {k}" for k in [*real, *thrown] if not k["safe"])
    return Outcome(tuple(rows), notes=notes)


def _process(seed: int, i: int) -> dict[str, Any]:
    """The process itself killed in one phase."""
    phase = PHASES[i % len(PHASES)]
    when = float(np.random.default_rng((seed, 42, i)).uniform(0.0, LATEST.get(phase, 1.5)))
    return killed(phase, when, 1000 * seed + i)


def _row(key: str, condition: str, kills: list[dict[str, Any]], budget: float | None = 1.0) -> Row:
    good = sum(bool(k["safe"]) for k in kills)
    what = "ended with the plug safely out"
    return share_row(key, what, condition, good, len(kills), None, budget, budget, "higher")


def _round(seed: int, i: int) -> dict[str, Any]:
    """One kill in every phase, in one cell that goes on."""
    rng = np.random.default_rng((seed, 41, i))
    cell = charging_cell()
    bench = StationBench(cell, 1000 * seed + i)
    car = SimulatedCar(seconds=2.0)
    kills = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "station.json"
        for phase in PHASES:
            station = make_station(bench, file, car)
            station.begin()
            reached = _until(bench, station, phase)
            when = float(rng.uniform(0.0, LATEST.get(phase, 1.5)))
            end = bench.now + when
            while bench.now < end and station.state is phase:
                bench.step(station)
            depth = bench.score()[0]
            again = make_station(bench, file, car)
            bench.stop()
            ended = bench.run(again, PATIENCE)
            words = again.outcomes[-1].problem if again.outcomes else again.words
            out = bench.score()[0] < -OUT or not np.isfinite(bench.score()[0])
            safe = reached and ended and out and not file.exists()
            kills.append(
                {
                    "phase": phase.value,
                    "safe": bool(safe),
                    "words": words,
                    "depth_mm": 1e3 * depth if np.isfinite(depth) else -1e3,
                }
            )
    return {"kills": kills}


def _until(bench: StationBench, station: Station, phase: State) -> bool:
    end = bench.now + PATIENCE
    while bench.now < end:
        bench.step(station)
        if station.state is phase:
            return True
    return False


EXPERIMENT = Experiment(
    "station-kill", "A charging station that is killed and started again", run, runs=20, about=ABOUT
)
