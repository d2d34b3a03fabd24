"""The phases of a visit in which a station is killed, and one visit killed in each of them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.views import travel_seconds
from armsight.charging.calibrate import uncalibrated
from armsight.charging.plug_views import plug_views
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import AT_LID, State
from armsight.devices.camera_models import stereo_pair
from armsight.experiments.charging_visits import TYPES, random_cell
from armsight.experiments.lid_visits import VEHICLES, lid_cell
from armsight.experiments.station_bench import StationBench, make_station
from armsight.experiments.station_doomed import FreshProcesses, kill_a_copy
from armsight.experiments.station_eyes import POST
from armsight.geometry.pose import inverse
from armsight.workcell.schema import Workcell

COPIES = 2
"""Of a visit under a lid are killed in each phase, at moments of their own: it takes long."""
PATIENCE = 240.0
"""For a visit in which nothing is killed [s]."""
Deed = Callable[[StationBench, Station], None]


@dataclass(frozen=True)
class Phase:
    """Of a visit.

    Attributes:
        name: in the table; state: of the station.
        latest: it is killed within so long after it began, or as it ends [s].
        after: the state from which a deed leads to it, for one that no good visit has; deed: that.
    """

    name: str
    state: State
    latest: float = 1.5
    after: State | None = None
    deed: Deed = lambda bench, station: None


def _end(bench: StationBench, station: Station) -> None:
    station.end()


def _person(bench: StationBench, station: Station) -> None:
    bench.withdrawn = "somebody is near the port"


PHASES = (
    Phase("find", State.FIND, 0.5),
    Phase("shows its plug", State.SHOW, 4.0),
    Phase("second look", State.LOOK, 3.0),
    Phase("approach", State.APPROACH),
    Phase("align", State.ALIGN, 3.0),
    Phase("tare", State.TARE, 0.4),
    Phase("insert", State.INSERT, 4.0),
    Phase("charge", State.CHARGE, 2.0),
    Phase("unplug", State.UNPLUG, 2.5),
    Phase("leave", State.LEAVE),
    Phase("on its way home", State.STAND_BY),
)
"""Of a car without a lid."""
LID_PHASES = (
    Phase("looks at the lid", State.LID_LOOK, 3.0),
    Phase("goes to the lid", State.LID_BEFORE, 3.0),
    Phase("aligns with the lid", State.LID_ALIGN, 1.0),
    Phase("tares at the lid", State.LID_TARE, 0.5),
    Phase("works the lid", State.LID_WORK, 10.0),
    Phase("held up at the lid", State.HELD, 1.0, State.LID_WORK, _person),
    Phase("leaves the lid", State.LID_AWAY, 3.0, State.LID_WORK, _end),
)
"""Of one that has a lid besides, as it opens it or as it shuts it."""


def plain_kills(seed: int, i: int) -> dict[str, Any]:
    """A car parked at random; a kill in each phase of its visit, the plug shown first."""
    rng = np.random.default_rng((seed, 43, i))
    cell = random_cell(rng, TYPES[i % len(TYPES)])
    return {"kills": _visit(cell, PHASES, 1000 * seed + i, rng, shown=True)}


def lid_kills(seed: int, i: int) -> dict[str, Any]:
    """Likewise a car whose port is under a lid: in turns as it is opened, and as it is shut."""
    rng = np.random.default_rng((seed, 44, i))
    cell = lid_cell(rng, tuple(VEHICLES)[i // 2 % len(VEHICLES)])
    return {"kills": _visit(cell, LID_PHASES, 1000 * seed + i, rng, COPIES, shutting=i % 2 == 1)}


def _visit(
    cell: Workcell,
    phases: tuple[Phase, ...],
    seed: int,
    rng: np.random.Generator,
    copies: int = 1,
    shown: bool = False,
    shutting: bool = False,
) -> list[dict[str, Any]]:
    """One visit, copies of it killed in each phase; it ends where no phase is left."""
    bench = StationBench(cell, seed)
    kills: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder, FreshProcesses(cell, bench.world.seed) as fresh:
        file = Path(folder) / "station.json"
        station = make_station(bench, file, SimulatedCar(seconds=2.5), shows=showing(cell, bench))
        if shown:
            station.check.ask()
        station.begin()
        left = list(phases)
        while left and bench.now < PATIENCE and (station.busy or bench.now < 1.0):
            bench.step(station)
            for phase in [p for p in left if _begins(p, station, shutting)]:
                left.remove(phase)
                for _ in range(copies):
                    life = _Life(phase, bench, station, rng)
                    dead = kill_a_copy(bench, life.go_on, station, file)
                    again = Path(folder) / "again.json"
                    found = fresh.follow(dead, again)
                    again.unlink(missing_ok=True)
                    kills.append({"phase": phase.name, "depth_mm": 1e3 * dead.depth, **found})
        words = station.outcomes[-1].problem if station.outcomes else station.words
    bench.world.close()
    never = {"safe": False, "words": f"the visit did not come to it: {words}"}
    return kills + [{"phase": p.name, **never} for p in left for _ in range(copies)]


def _begins(phase: Phase, station: Station, shutting: bool) -> bool:
    if station.state is not (phase.after or phase.state):
        return False
    if station.state in AT_LID:
        assert station.finger is not None
        return station.finger.shutting == shutting
    return station.state is not State.STAND_BY or bool(station.outcomes)


class _Life:
    """What is left to a copy of a visit: to its phase, if it has to be led there, and on in it."""

    def __init__(
        self, phase: Phase, bench: StationBench, station: Station, rng: np.random.Generator
    ) -> None:
        self._phase, self._bench, self._station = phase, bench, station
        self._deed = bench.now if phase.after is None else bench.now + rng.uniform(0.5, 8.0)
        self._left = float(rng.uniform(0.0, phase.latest))
        self._end = np.inf

    def go_on(self) -> bool:
        """One step; whether it lives on."""
        bench, station, phase = self._bench, self._station, self._phase
        if phase.after is not None and bench.now >= self._deed and station.state is phase.after:
            phase.deed(bench, station)
        if station.state is phase.state and self._end == np.inf:
            self._end = bench.now + self._left
        if bench.now >= self._end:
            return False
        bench.step(station)
        led = station.state is phase.after
        return led or (station.state is phase.state)


def showing(cell: Workcell, bench: StationBench) -> tuple[JointVector, ...]:
    """Joints that hold the plug before the standing pair, the soonest there first [rad]."""
    robot = bench.robot
    assert robot.tool is not None
    pair = next(p for p in cell.stereo if p.name == POST)
    assert cell.plug is not None
    assert pair.model is not None
    T_base_camera = inverse(cell.robot.T_world_base) @ pair.T_mount_camera
    believed = uncalibrated(T_base_camera, robot.tool.T_flange_tcp, RobotErrors(robot))
    rng = np.random.default_rng(0)
    joints = plug_views(believed, robot, stereo_pair(pair.model), cell.plug.kind, 30, rng)[0]
    away = travel_seconds(robot, robot.home, joints, 1.0, 1.0)
    return tuple(joints[k] for k in np.argsort(away)[:3])
