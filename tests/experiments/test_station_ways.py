"""The bench's arm goes round the car, and round what is declared."""

import numpy as np
import pytest

from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.charging_visits import random_cell
from armsight.experiments.station_bench import StationBench, make_station
from armsight.motion.intents import JointIntent


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
