"""One visit of the charging station on its bench: a parked car, plugged in, charged, out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.charging.permission import SPEED
from armsight.charging.ports.table import PORTS
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import Outcome, State
from armsight.experiments.station_bench import (
    Peaks,
    StationBench,
    charging_cell,
    make_station,
    parked,
)
from armsight.experiments.station_eyes import POST, Mode
from armsight.experiments.station_weather import Surroundings
from armsight.robots.kinematics import tcp_pose
from armsight.simulation.truth import Contact
from armsight.simulation.world import SimulatedWorld
from armsight.workcell import robot_in
from armsight.workcell.car import PORT
from armsight.workcell.schema import Workcell

TYPES = ("type2", "type1", "ccs2")
"""Inlets, in turn."""
SHORT, TILT = 1e-3, float(np.deg2rad(2.0))
"""A plug is fully in that is so near its seat [m] and so straight [rad]."""
FORCE = 125.0
"""That the station's permit asks for [N]."""
CLEAR = 0.08
"""Of the plug at stand-by before a parked car's flank, at least [m]."""
SECONDS = 150.0
"""A visit on the bench at most [s]."""


def random_cell(rng: np.random.Generator, port: str = "type2") -> Workcell:
    """The packaged cell of an inlet, its car parked at random, but not into the waiting plug."""
    cell = charging_cell(port)
    robot = robot_in(cell)
    waits = (cell.robot.T_world_base @ tcp_pose(robot, robot.home))[:3, 3]
    while True:
        place = rng.uniform((0.84, -0.05, 0.75), (1.04, 0.15, 0.95))
        yaw, lean = 180.0 + rng.uniform(-10.0, 10.0), rng.uniform(0.0, 20.0)
        along, up = np.deg2rad(yaw), np.deg2rad(lean)
        outwards = (np.cos(along) * np.cos(up), np.sin(along) * np.cos(up), np.sin(up))
        if np.dot(outwards, waits - place) > CLEAR:
            break
    x, y, z = (float(v) for v in place)
    return parked(cell, (x, y, z), float(yaw), lean_deg=float(lean), **_make(rng))


def light_at_random(world: SimulatedWorld, rng: np.random.Generator) -> None:
    """Dim to glaring, each lamp by itself, so that shadows and shine come from anywhere."""
    world.relight(rng.uniform(0.2, 1.8, world.lamps), float(rng.uniform(0.4, 1.3)))


def angled_cell(rng: np.random.Generator, degrees: float) -> Workcell:
    """The packaged Type 2 cell, its port at an angle to the standing pair's line of sight.

    Args:
        rng: of the port's place (within 4 cm) and of plug and socket.
        degrees: between the port's axis and that line, about the vertical.
    """
    cell = charging_cell()
    pair = next(p for p in cell.stereo if p.name == POST)
    eye = np.asarray(pair.T_mount_camera)[:3, 3]  # of a file: in world
    place = np.array([0.92, 0.05, 0.85]) + rng.uniform(-0.02, 0.02, 3)
    line = eye - place
    yaw = float(np.rad2deg(np.arctan2(line[1], line[0]))) + degrees
    x, y, z = (float(v) for v in place)
    return parked(cell, (x, y, z), yaw, lean_deg=0.0, **_make(rng))


def _make(rng: np.random.Generator) -> dict[str, float]:
    return {
        "clearance_mm": float(rng.uniform(0.3, 0.6)),
        "chamfer_mm": float(rng.uniform(1.5, 2.0)),
        "friction": float(rng.uniform(0.1, 0.4)),
        "mated_n": float(rng.uniform(10.0, 35.0)),
    }


def fully_in(cell: Workcell, depth: float, tilt: float) -> bool:
    """Whether a plug that is so deep [m] and bent [rad] is where it belongs."""
    assert cell.plug is not None
    return bool(depth > PORTS[cell.plug.kind].depth - SHORT and tilt < TILT)


def bench_visit(
    cell: Workcell,
    seed: int,
    rendered: bool = False,
    mode: Mode = "ours",
    second_look: bool = True,
    around: Surroundings | None = None,
) -> dict[str, Any]:
    """A visit in contact physics, scored by the truth.

    Args:
        cell: with its car parked.
        seed: of everything random.
        rendered: whether the looks are pictures, rendered and searched; else they are drawn.
        mode: of the station.
        second_look: whether it looks again from near.
        around: where the pair stands, light and weather; None: light at random alone.
    """
    cell = cell if around is None else around.moved(cell)
    bench = StationBench(cell, seed, rendered, mode, around)
    with bench.world:
        if around is None:
            light_at_random(bench.world, np.random.default_rng((seed, 55)))
        station = make_station(bench, None, SimulatedCar(seconds=2.0), mode, second_look)
        station.begin()
        said, depth, tilt = False, float("nan"), float("nan")
        while bench.now < SECONDS and station.busy and station.state is not State.STUCK:
            bench.step(station)
            if station.state is State.CHARGE and not said:
                said, (depth, tilt) = True, bench.score()
        outcome = station.outcomes[-1] if station.outcomes else station.outcome
        found = figures(cell, outcome, said, depth, tilt)
        found |= {} if around is None else {"place": around.place, "light": around.light}
        return found | at_the_end(bench.world, outcome, bench.peaks, bench.score()[0])


def uncovered(contacts: Sequence[Contact]) -> list[Contact]:
    """Those that no permit of the port covers.

    It lets the plug touch the port, as fast and as hard as was asked for.
    """
    return [c for c in contacts if c.owner != PORT or c.arm_speed > SPEED or c.force > FORCE]


def at_the_end(
    world: SimulatedWorld, outcome: Outcome, peaks: Peaks, depth: float
) -> dict[str, Any]:
    """Whether the plug, now so deep [m], is out; what was done to anybody or anything till then."""
    touched = uncovered(world.truth.moving_contacts)
    return {
        "out": bool(outcome.out and depth < 0.0),
        "axial_n": peaks.axial,
        "lateral_n": peaks.lateral,
        "pull_n": peaks.pull,
        "harm": bool(touched or max(peaks.axial, peaks.lateral) > FORCE),
    }


def figures(
    cell: Workcell, outcome: Outcome, said: bool, depth: float, tilt: float
) -> dict[str, Any]:
    """What the station says of a visit beside what is true of it."""
    nan = float("nan")
    assert cell.plug is not None
    return {
        "plug": cell.plug.kind,
        "said": said,
        "full": said and fully_in(cell, depth, tilt),
        "depth_mm": 1e3 * depth,
        "tilt_deg": float(np.rad2deg(tilt)),
        "problem": outcome.problem,
        "tries": outcome.tries,
        "score": outcome.score,
        "cycle_s": outcome.plugged - outcome.began if said else nan,
        "insert_s": outcome.plugged - outcome.approached if said else nan,
    }
