"""Visits of the charging station in contact physics, cars parked at random."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.cache import RunCache
from armsight.experiments.charging_faults import FAULTS, faulty_visit
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.experiments.station_bench import StationBench, charging_cell, parked
from armsight.experiments.station_kill import make_station
from armsight.workcell.schema import Workcell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERSION = 3
ABOUT = """
The packaged charging cell in contact physics (`experiments/station_bench.py`): the station, its
law, the arm with its errors, the plug in its soft mount with cable, the force sensor. *Not* in it:
the guard, the map, pictures; looks are drawn from what calibration and pictures leave (3 mm and 1
deg from afar, 0.8 mm and 0.6 deg from near, standard deviations). So these rows carry a `bench_`
before the issue's words and no budget. Cars are parked within 10 x 20 cm and 10 deg, the port at
0.75 to 0.95 m, looking up by 0 to 10 deg; clearance 0.3 to 0.6 mm, friction 0.1 to 0.4, mated
contacts 10 to 35 N. Seated: within 1 mm of the seat and 2 deg by the truth while the station says
that it charges. In half as many visits something goes wrong, six kinds in turn: ice in the inlet
(8 to 28 mm deep), an inlet of another type, a car that drives off, one that is moved by 3 cm
without a word, a permit that is withdrawn, a force sensor that dies. Recovered: out again (or,
without a force sensor, known to be in and left there), nothing pressed with more than 125 N, and
the words say what it was, or it ended seated after all (moved, permit).
"""
DEPTH, TILT = 0.034, np.deg2rad(2.0)
"""Of a Type 2 plug that is fully in [m], [rad]."""
FIRST_FAULT = 10**6
"""Number of the first visit that goes wrong, in the cache."""
FORCE = 125.0
"""That the station's permit asks for [N]."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` visits."""
    cache = RunCache("charging", seed, {"version": VERSION})
    visits, wrong = [], []
    faulty = max(1, runs // 2)
    for i in range(runs):
        progress("visit", i / (runs + faulty))
        visits.append(cache.get(i, partial(_visit, seed, i)))
    for i in range(faulty):
        progress("visit that goes wrong", (runs + i) / (runs + faulty))
        wrong.append(cache.get(FIRST_FAULT + i, partial(_fault, seed, i)))
    rows = (*_rows(visits), *_fault_rows(wrong))
    return Outcome(rows, {"visits": lambda: _plot(visits)})


def _fault(seed: int, i: int) -> dict[str, Any]:
    cell = _cell(np.random.default_rng((seed, 52, i)))
    return faulty_visit(cell, FAULTS[i % len(FAULTS)], 1000 * seed + 500 + i, FORCE)


def _visit(seed: int, i: int) -> dict[str, Any]:
    cell = _cell(np.random.default_rng((seed, 51, i)))
    bench = StationBench(cell, 1000 * seed + i)
    station = make_station(bench, None, SimulatedCar(seconds=2.0))
    station.begin()
    said = full = False
    while bench.now < 150.0 and (station.busy or not said):
        bench.step(station)
        if station.state is State.CHARGE and not said:
            said = True
            depth, tilt = bench.score()
            full = bool(depth > DEPTH and tilt < TILT)
        if not station.busy:
            break
    outcome = station.outcomes[-1] if station.outcomes else station.outcome
    nan = float("nan")
    return {
        "said": said,
        "full": full,
        "out": bool(outcome.out and bench.score()[0] < 0.0),
        "problem": outcome.problem,
        "tries": outcome.tries,
        "cycle_s": outcome.plugged - outcome.began if said else nan,
        "insert_s": outcome.plugged - outcome.approached if said else nan,
        "axial_n": bench.peaks.axial,
        "lateral_n": bench.peaks.lateral,
    }


def _cell(rng: np.random.Generator) -> Workcell:
    """The packaged cell, its car parked at random."""
    return parked(
        charging_cell(),
        (
            float(rng.uniform(0.87, 0.97)),
            float(rng.uniform(-0.05, 0.15)),
            float(rng.uniform(0.75, 0.95)),
        ),
        180.0 + float(rng.uniform(-10.0, 10.0)),
        lean_deg=float(rng.uniform(0.0, 10.0)),
        clearance_mm=float(rng.uniform(0.3, 0.6)),
        chamfer_mm=float(rng.uniform(1.5, 2.0)),
        friction=float(rng.uniform(0.1, 0.4)),
        mated_n=float(rng.uniform(10.0, 35.0)),
    )


def _rows(visits: list[dict[str, Any]]) -> list[Row]:
    n = len(visits)
    where = "contact physics, looks drawn"
    rows = [
        _share("bench_seated", "fully in, and said so", where, visits, "full"),
        _share("bench_out", "out again at the end", where, visits, "out"),
    ]
    partial_ones = sum(v["said"] and not v["full"] for v in visits)
    rows.append(
        Row(
            "bench_partial_as_success", "said to charge, and not fully in", where, partial_ones, n=n
        )
    )
    harm = sum(v["axial_n"] > FORCE for v in visits)
    rows.append(Row("bench_harm", f"visits with more than {FORCE:.0f} N", where, harm, n=n))
    for key, what, unit in (
        ("cycle_s", "stand-by to seated, median", "s"),
        ("insert_s", "from the approach pose to seated, median", "s"),
        ("axial_n", "greatest axial force of a visit, median", "N"),
        ("lateral_n", "greatest lateral force of a visit, median", "N"),
    ):
        values = np.array([v[key] for v in visits if np.isfinite(v[key])])
        if len(values):
            low, high = float(values.min()), float(values.max())
            median = float(np.median(values))
            rows.append(Row(f"bench_{key}", what, where, median, unit, len(values), low, high))
    return rows


def _fault_rows(wrong: list[dict[str, Any]]) -> list[Row]:
    where = "contact physics, looks drawn"
    for visit in wrong:
        visit["good"] = visit["safe"] and visit["named"]
    rows = [_share("bench_recovered", "ended safe and named rightly", where, wrong, "good")]
    for fault in FAULTS:
        mine = [v for v in wrong if v["fault"] == fault]
        if mine:
            rows.append(_share("bench_recovered_of", "the same", fault, mine, "good"))
    peaks = [v["axial_n"] for v in wrong]
    what = "greatest axial force in visits that go wrong, greatest"
    rows.append(Row("bench_fault_axial_n", what, where, max(peaks), "N", n=len(peaks)))
    return rows


def _share(key: str, what: str, condition: str, some: list[dict[str, Any]], field: str) -> Row:
    good = sum(bool(v[field]) for v in some)
    low, high = wilson(good, len(some))
    value = good / max(len(some), 1)
    return Row(key, what, condition, value, n=len(some), low=low, high=high, better="higher")


def _plot(visits: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.2))
    for i, (key, label) in enumerate((("cycle_s", "stand-by to seated [s]"), ("axial_n", "N"))):
        axes = figure.add_subplot(1, 2, i + 1)
        values = np.sort([v[key] for v in visits if np.isfinite(v[key])])
        axes.step(values, np.arange(1, len(values) + 1) / max(len(visits), 1), where="post")
        axes.set_xlabel(label)
        axes.set_ylabel("share of visits")
        axes.set_ylim(0, 1.02)
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "charging", "The charging station's visits, in contact physics", run, runs=100, about=ABOUT
)
