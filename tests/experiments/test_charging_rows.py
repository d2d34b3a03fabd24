"""Rows of charging visits: what is counted as what, and when two conditions agree."""

import math

import numpy as np

from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import State
from armsight.experiments.charging_rows import agreement_row, fault_rows, rows_of, visit_rows
from armsight.experiments.charging_visits import uncovered
from armsight.experiments.station_bench import StationBench, charging_cell, make_station
from armsight.simulation.truth import Contact


def visit(full=True, said=True, harm=False, out=True):
    return {
        "said": said, "full": full and said, "harm": harm, "out": out, "pull_n": 30.0,
        "cycle_s": 15.0 if said else math.nan, "insert_s": 8.0 if said else math.nan,
        "axial_n": 80.0, "lateral_n": 10.0,
    }  # fmt: skip


def test_a_visit_that_says_it_is_in_and_is_not_is_counted_against_it():
    visits = [visit(), visit(full=False), visit(said=False), visit(harm=True)]
    rows = {row.key: row for row in visit_rows(visits, "here")}
    assert rows["seated"].value == 0.5
    assert rows["partial_as_success"].value == 1
    assert rows["partial_as_success"].met is False
    assert rows["harm"].value == 1
    assert rows["unplugged"].n == 3  # of those that said they were seated
    assert rows["cycle_s"].n == 3
    assert rows["unplug_n"].met


def test_rows_of_other_ways_hold_no_budget():
    every = [*visit_rows([visit()], "here", "bench_"), *fault_rows(
        [{"fault": "numb", "good": True}], "here", "bench_"
    )]  # fmt: skip
    assert all(row.key.startswith("bench_") and row.must is None for row in every)


def test_forces_while_somebody_moves_the_car_are_of_those_visits_alone():
    forces = {"axial_n": 80.0, "lateral_n": 20.0, "pull_n": 40.0}
    wrong = [{"fault": "numb", "good": True, **dict.fromkeys(forces, 300.0)},
             {"fault": "pushed", "good": True, **forces}]  # fmt: skip
    rows = {row.key: row for row in fault_rows(wrong, "here")}
    assert {key: rows[f"moved_{key}"].value for key in forces} == forces


def test_seated_visits_are_told_by_what_was_drawn_of_them():
    visits = [visit() | {"light": "dim"}, visit(said=False) | {"light": "dim"},
              visit() | {"light": "glare"}]  # fmt: skip
    rows = {row.condition: row for row in rows_of(visits, "here", "light")}
    assert (rows["here: dim"].value, rows["here: dim"].n, rows["here: glare"].value) == (0.5, 2, 1)


def test_two_conditions_agree_where_the_interval_of_their_difference_holds_nothing():
    good, bad = [visit()] * 20, [visit(said=False)] * 20
    same, other = agreement_row(good, good[:3], "a"), agreement_row(good, bad, "b")
    assert same.low < 0.0 < same.high
    assert other.value == 1.0
    assert other.low > 0.5


def test_waiting_for_people_is_not_held_to_the_budget_of_an_empty_cell():
    keys = {row.key: row for row in visit_rows([visit()], "here", waits=True)}
    assert "insert_s" not in keys
    assert keys["waited_insert_s"].must is None
    assert keys["seated"].must == 0.95


def test_without_its_second_look_a_station_goes_on_to_the_approach():
    bench = StationBench(charging_cell(), 5)
    after = []
    with bench.world:
        for second_look in (True, False):
            station = make_station(bench, None, SimulatedCar(), second_look=second_look)
            station.begin()
            while station.state in (State.STAND_BY, State.FIND) and bench.now < 20.0:
                bench.step(station)
            after.append(station.state)
    assert after == [State.LOOK, State.APPROACH]


def test_the_port_may_be_touched_as_fast_and_as_hard_as_was_granted_and_nothing_else():
    def touch(owner="port", speed=0.055, force=70.0):
        at = np.zeros(3)
        return Contact("static", owner, "", 6, 1.0, 1.1, 1e-5, speed, at, force=force)

    covered = [touch(), touch(force=math.nan)]
    harm = [touch("car/under"), touch(speed=0.07), touch(force=130.0), touch("visitor")]
    assert uncovered([*covered, *harm]) == harm
