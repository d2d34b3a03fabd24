"""Visits in which something goes wrong: do they end safely, and say rightly what it was?"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.car_nudges import KINDS, Kind, Nudge, drawn
from armsight.experiments.charging_visits import FORCE, fully_in
from armsight.experiments.station_bench import StationBench, make_station
from armsight.experiments.station_weather import Surroundings
from armsight.geometry.pose import make_pose
from armsight.workcell.schema import Workcell

Fault = Literal["blocked", "other type", "drives off", "moved", "person", "numb"] | Kind
FAULTS: tuple[Fault, ...] = (
    "blocked", "other type", "drives off", "moved", "person", "numb", *KINDS,
)  # fmt: skip
"""Ice in the inlet; another inlet than the plug's; a car that says that it goes, with the plug
before it or in it; one that was moved without a word while the plug was on its way; the guard's
permit withdrawn for somebody who comes near; a force sensor that dies; a car that somebody pushes,
leans on or draws away without a word while the plug goes in, is in, or comes out."""
NAMED: dict[Fault, str] = {
    "blocked": "jammed",
    "other type": "does not fit",
    "drives off": "the car moves",
    "person": "somebody",
    "numb": "the force sensor is silent",
}
"""What has to stand in the words of such a visit."""
ENDS_SEATED: tuple[Fault, ...] = ("moved", "person", *KINDS)
"""After these a visit may as well end seated: nothing is wrong any more."""
SECONDS = 200.0
OUT = 0.05
"""The plug is out when it is so far before the face [m]."""


def faulty_visit(
    cell: Workcell,
    fault: Fault,
    seed: int,
    rendered: bool = False,
    around: Surroundings | None = None,
) -> dict[str, Any]:
    """One visit in which something goes wrong.

    Args:
        cell: with a car that is parked somewhere.
        fault: what goes wrong.
        seed: of when, and of everything else.
        rendered: whether pictures are rendered and searched; else looks are drawn.
        around: where the pair stands, light and weather; None: as the cell's file has it.

    Returns:
        Whether it ended safe (out, or known to be in; nothing pressed with more than allowed) and
        whether what it says is right.
    """
    rng = np.random.default_rng((seed, 53))
    cell = _with(cell if around is None else around.moved(cell), fault, rng)
    bench = StationBench(cell, seed, rendered, around=around)
    car = SimulatedCar(seconds=10.0 if fault in KINDS else 20.0)
    station = make_station(bench, None, car)
    station.begin()
    when = _moment(fault, rng)
    due = np.inf
    seated, nudged = False, None
    while bench.now < SECONDS and (station.busy or bench.now < 1.0):
        bench.step(station)
        if due == np.inf and station.state is when[0]:
            due = bench.now + when[1]
        if bench.now >= due and bench.now < due + 0.02:
            _happen(fault, bench, car, rng)
        if fault in KINDS and bench.now >= due:
            nudged = nudged or _Nudged(fault, bench, rng)
            nudged.move()
        if fault == "person" and bench.now > due + 3.0:
            bench.withdrawn = ""
        seated |= station.state is State.CHARGE and fully_in(cell, *bench.score())
        if station.state is State.STUCK:
            break
    bench.world.close()
    return {
        "fault": fault,
        "during": when[0].value,
        **_judged(bench, station, fault, seated),
    }


def _judged(bench: StationBench, station: Station, fault: Fault, seated: bool) -> dict[str, Any]:
    outcome = station.outcomes[-1] if station.outcomes else station.outcome
    depth = bench.score()[0]
    out = bool(depth < -OUT)
    stays = fault == "numb" and station.state is State.STUCK and not outcome.out
    gentle = max(bench.peaks.axial, bench.peaks.lateral) <= FORCE
    named = NAMED.get(fault, "?") in (outcome.problem or station.words)
    named |= seated and fault in ENDS_SEATED
    safe = bool((out or stays) and gentle)
    return {
        "safe": safe,
        "named": bool(named),
        "good": safe and bool(named),
        "words": outcome.problem or station.words,
        "seconds": bench.now,
        "axial_n": bench.peaks.axial,
        "lateral_n": bench.peaks.lateral,
        "pull_n": bench.peaks.pull,
    }


class _Nudged:
    """The car of a bench, moved by somebody from now on."""

    def __init__(self, kind: Kind, bench: StationBench, rng: np.random.Generator) -> None:
        assert bench.world.car is not None
        self._bench, self._car = bench, bench.world.car
        self._begun, self._T_before = bench.now, self._car.T_world_socket.copy()
        self._nudge: Nudge = drawn(kind, self._T_before, rng)

    def move(self) -> None:
        """It stands where it is now."""
        self._car.T_world_socket = self._nudge.at(self._bench.now - self._begun, self._T_before)


def _with(cell: Workcell, fault: Fault, rng: np.random.Generator) -> Workcell:
    car = cell.simulation.car
    assert car is not None
    if fault == "blocked":
        car = car.model_copy(update={"blocked_mm": float(rng.uniform(8.0, 28.0))})
    elif fault == "other type":
        car = car.model_copy(update={"port": "type1", "vehicle": "city_car"})
    simulation = cell.simulation.model_copy(update={"car": car})
    return cell.model_copy(update={"simulation": simulation})


def _moment(fault: Fault, rng: np.random.Generator) -> tuple[State, float]:
    """The state in which it happens, and how long after that began [s]."""
    moved = (State.INSERT, State.CHARGE, State.UNPLUG)
    states: tuple[State, ...] = {
        "drives off": (State.APPROACH, State.ALIGN, State.INSERT, State.CHARGE),
        "moved": (State.APPROACH, State.ALIGN),
        "person": (State.INSERT, State.CHARGE),
        "numb": (State.INSERT,),
        "pushed": moved,
        "leaned on": moved,
        "drawn away": moved,
    }.get(fault, (State.FIND,))
    state = states[int(rng.integers(len(states)))]
    return state, float(rng.uniform(0.05, 1.5 if state is State.UNPLUG else 3.0))


def _happen(fault: Fault, bench: StationBench, car: SimulatedCar, rng: np.random.Generator) -> None:
    if fault == "drives off":
        car.parked = False
    elif fault == "moved" and bench.world.car is not None and bench.world.car.parked:
        turn = rng.uniform(0.0, 2.0 * np.pi)
        step = make_pose(None, 0.03 * np.array([np.cos(turn), np.sin(turn), 0.0]))
        bench.world.car.park(bench.world.car.T_world_socket @ step)
    elif fault == "person":
        bench.withdrawn = "somebody is near the port"
    elif fault == "numb":
        bench.numb = True
