"""The station killed in every phase of a visit and started again: does the plug end safely?"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from armsight.charging.admittance import Admittance
from armsight.charging.insert import InsertOptions
from armsight.charging.journal import Journal
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State, StationOptions
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.experiments.station_bench import StationBench, charging_cell

VERSION = 4
ABOUT = """
The packaged charging cell in contact physics (`experiments/station_bench.py`: no guard, looks drawn
from the pairs' errors). In each phase of a visit, at a random moment of it, everything that the
program knows is thrown away but the station's file; the arm stops; a new station starts from that
file. Safe: it ends with the plug out of the car by the truth (more than 5 cm before its face), the
file gone, nobody asked for help; or it had nothing to do. The process itself is not killed: the
file is written whole or not at all, which `tests/charging` tests.
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
OUT = 0.05
"""The plug is out when it is so far before the face [m]."""
HOMEWARD = 10.0
"""From the end of a visit to the stand-by [s]."""
PATIENCE = 120.0
"""For each part of a visit [s]."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` kills in each of nine phases."""
    cache = RunCache("station-kill", seed, {"version": VERSION})
    found: list[dict[str, Any]] = []
    for i in range(runs):
        progress("kill", i / runs)
        found += cache.get(i, partial(_round, seed, i))["kills"]
    rows = []
    for phase in PHASES:
        mine = [k for k in found if k["phase"] == phase.value]
        rows.append(_row("safe_after_kill", phase.value, mine))
    rows.append(_row("safe_after_kill", "all phases", found))
    return Outcome(tuple(rows))


def _row(key: str, condition: str, kills: list[dict[str, Any]]) -> Row:
    good = sum(bool(k["safe"]) for k in kills)
    low, high = wilson(good, len(kills))
    return Row(
        key,
        "ended with the plug safely out",
        condition,
        good / max(len(kills), 1),
        n=len(kills),
        low=low,
        high=high,
        must=1,
        aim=1,
        better="higher",
    )


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
            home = bench.now + HOMEWARD
            while ended and bench.now < home and bench.score()[0] > -OUT:
                bench.step(again)  # one that had nothing to end still goes home
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


def make_station(bench: StationBench, file: Path | None, car: SimulatedCar) -> Station:
    """A station of the bench's cell."""
    cell = bench.workcell
    near = next(p.T_mount_camera for p in cell.stereo if p.mounted_on == "flange")
    mount = Admittance((5000.0, 30.0), 0.074)
    options = StationOptions(insert=InsertOptions(admittance=mount, port_depth=0.002))
    return Station(bench.robot, bench.robot.home, car, Journal(file), options, near)


EXPERIMENT = Experiment(
    "station-kill", "A charging station that is killed and started again", run, runs=20, about=ABOUT
)
