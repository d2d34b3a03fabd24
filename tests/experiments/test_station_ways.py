"""The bench's arm goes round the car, and round what is declared."""

import numpy as np
import pytest

from armsight.charging.eye import SeenPort
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.charging_visits import random_cell
from armsight.experiments.station_bench import StationBench, make_station
from armsight.geometry.pose import make_pose
from armsight.motion.intents import JointIntent, PoseIntent
from armsight.motion.permits import PermitRequest
from armsight.motion.regions import Region
from armsight.workcell.packaged import load


@pytest.fixture
def parked():
    """A bench and its station as a visit begins, a CCS2 close to the waiting plug."""
    cell = random_cell(np.random.default_rng((2053, 51, 101)), "ccs2")
    bench = StationBench(cell, 20530101)
    with bench.world:
        station = make_station(bench, None, SimulatedCar(seconds=1.0))
        station.begin()
        yield bench, station


def test_the_plug_is_led_round_the_car(parked):
    """On a straight line of joint angles this one touched the car's side with 87 N."""
    bench, station = parked
    while station.state is not State.ALIGN:
        assert bench.now < 20.0, f"still in {station.state}: {station.words}"
        bench.step(station)
    assert bench.world.truth.moving_contacts == []


def test_a_goal_in_the_car_is_refused_once_its_port_was_found(parked):
    bench, station = parked
    home = bench.robot.home
    inwards = home + np.array([0.0, 0.5, -0.2, 0.0, 0.0, 0.0])
    into = JointIntent("into the car", inwards)
    assert bench.ways.plan(into, home).trajectory is not None, "nobody knows of the car"
    while station.port is None:
        bench.step(station)
    plan = bench.ways.plan(into, home)
    assert plan.trajectory is None
    assert plan.failure.startswith("goal: ")


def test_behind_a_lid_the_finger_may_be_where_it_is_permitted():
    """Counted as if it were always out, it is too near the body before the port otherwise."""
    cell = load("ur10_charging_lid")
    bench = StationBench(cell, 5)
    with bench.world:
        T = bench.T_base_port
        six = np.diag([4e-6, 4e-6, 4e-6, 3e-5, 3e-5, 3e-5])
        bench.ways.found(SeenPort("type2", 0.97, T, six, False), lid_open=True)
        before = T @ make_pose(np.diag([-1.0, 1.0, -1.0]), (0.0, 0.0, 0.10))
        region = Region("box", (0.2, 0.2, 0.2), T, 0.0)
        into = PoseIntent("approach", before, permit=PermitRequest("port", "thing", region))
        home = bench.robot.home
        assert bench.ways.plan(into, home).trajectory is not None
        refused = bench.ways.plan(into, home, granted=False)
        assert refused.failure.startswith("goal: wrist_3_link touches something")
