"""Whole visits of a car whose port is under a lid: found, opened, plugged in, out, shut."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.charging.vehicle import SimulatedCar
from armsight.experiments.station_bench import StationBench, make_station, parked
from armsight.simulation.spec import Latch
from armsight.workcell.packaged import load
from armsight.workcell.schema import Workcell

CELL = "ur10_charging_lid"
VEHICLES: dict[Latch, str] = {"push": "hatchback_lid", "spring": "hatchback_catch"}
SECONDS = 170.0
"""For a visit at most [s]."""


def lid_cell(rng: np.random.Generator, latch: Latch) -> Workcell:
    """The packaged cell, its car parked at random within 10 x 20 cm and 10 deg."""
    cell = load(CELL)
    car, plug = cell.simulation.car, cell.plug
    assert car is not None
    assert plug is not None
    x, y, z = car.position
    place = (x + float(rng.uniform(-0.05, 0.05)), y + float(rng.uniform(-0.1, 0.1)), z)
    vehicle = VEHICLES[latch]
    cell = cell.model_copy(update={"plug": plug.model_copy(update={"vehicle": vehicle})})
    return parked(
        cell,
        place,
        car.yaw_deg + float(rng.uniform(-10.0, 10.0)),
        vehicle=vehicle,
        lean_deg=float(rng.uniform(0.0, 5.0)),
        friction=float(rng.uniform(0.1, 0.4)),
        lid_holds_n=float(rng.uniform(15.0, 30.0)),
    )


def lid_visit(seed: int, i: int, latch: Latch) -> dict[str, Any]:
    """One visit, its pictures rendered and searched; scored by the truth."""
    cell = lid_cell(np.random.default_rng((seed, 63, i)), latch)
    bench = StationBench(cell, 1000 * seed + i, rendered=True)
    with bench.world:
        station = make_station(bench, None, SimulatedCar(seconds=1.0))
        station.begin()
        bench.run(station, SECONDS)
        outcome = station.outcomes[-1] if station.outcomes else station.outcome
        lid = bench.world.lid
        assert lid is not None
        return {
            "latch": latch,
            "opened": outcome.lid_opened and outcome.seated,
            "shut": bool(outcome.lid_shut and lid.shut),
            "seated": outcome.seated,
            "out": bool(outcome.out and bench.score()[0] < -0.05),
            "cycle_s": outcome.plugged - outcome.began,
            "visit_s": outcome.ended - outcome.began,
            "problem": outcome.problem or ("" if station.outcomes else station.words),
        }
