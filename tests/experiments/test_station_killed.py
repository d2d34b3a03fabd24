"""Kills are real: a copy of a visit ends by SIGKILL, and what follows it knows the file alone."""

import os

import numpy as np
import pytest

from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.errors import ArmsightError
from armsight.experiments.station_bench import StationBench, charging_cell, make_station
from armsight.experiments.station_doomed import FreshProcesses, Left, kill_a_copy
from armsight.experiments.station_phases import LID_PHASES, PHASES, showing


@pytest.fixture
def visit(tmp_path):
    """A visit on its way to the second look, and its file."""
    bench, file = StationBench(charging_cell(), 5), tmp_path / "station.json"
    station = make_station(bench, file, SimulatedCar())
    station.begin()
    while station.state is not State.LOOK:
        bench.step(station)
    yield bench, station, file
    bench.world.close()


def test_a_copy_goes_on_and_is_killed_and_the_visit_is_as_it_was(visit):
    bench, station, file = visit
    before, now, end = file.read_bytes(), bench.now, bench.now + 0.5

    def go_on():
        file.write_text("what the copy wrote")
        bench.step(station)
        return bench.now < end

    left = kill_a_copy(bench, go_on, station, file)
    assert left.file == b"what the copy wrote"
    assert (file.read_bytes(), bench.now) == (before, now)
    here = bench.world.memory.take()["joints"]
    assert np.abs(np.subtract(left.world["joints"], here)[:6]).max() > 0.01, "it went on"


def test_a_copy_that_ends_otherwise_is_no_kill(visit):
    bench, station, file = visit
    for last_act in (lambda: os._exit(0), lambda: 1 / 0):
        with pytest.raises(ArmsightError, match="not by SIGKILL"):
            kill_a_copy(bench, last_act, station, file)


def test_what_follows_is_another_process_that_reads_the_file_and_comes_home(visit, tmp_path):
    bench, station, file = visit
    for _ in range(60):
        bench.step(station)
    world, again = bench.world.memory.take(), tmp_path / "again.json"
    with FreshProcesses(bench.workcell, 7) as fresh:
        found = fresh.follow(Left(world, file.read_bytes(), -0.2, "second look"), again)
        assert found["safe"]
        assert found["words"].startswith("was stopped")
        assert not again.exists()
        without = fresh.follow(Left(world, None, -0.2, ""), again)
        assert without["words"] == "", "without its file it knows of no visit"
        with pytest.raises(ArmsightError, match="ended with status"):
            fresh.follow(Left({}, None, -0.2, ""), again)


def test_every_state_in_which_a_station_is_at_work_is_a_phase():
    states = {phase.state for phase in (*PHASES, *LID_PHASES)}
    assert states == set(State) - {State.STUCK}


def test_the_plug_is_shown_where_both_lenses_see_it():
    bench = StationBench(charging_cell(), 5)
    with bench.world:
        places = showing(bench.workcell, bench)
    assert len(places) == 3
    assert all(np.abs(q - bench.robot.home).max() > 0.1 for q in places)
