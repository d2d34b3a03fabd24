"""What stands where the surface should be and feels nothing goes on, slowly, and no farther."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armsight.motion.permits import Permit, PermitState
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.creeping import CREEPS, STANDS, Creeping
from armsight.servoing.docking import DOCK_NAMES, docking

from .test_laws import HOME
from .test_laws import look as look_at_place
from .test_servo_task import UR10, observe, task_of

TIP = tcp_pose(UR10, HOME)
AHEAD = TIP[:3, 3] + 0.042 * TIP[:3, 2]


def stood(seconds, felt=lambda by: 0.0, dock="ball", standoff=0.0, seen=True, permit=True):
    """How far a tip that stands 2 mm before a ball has gone on, each round, and its task."""
    task, by = task_of(dock=dock, standoff=standoff), []
    for k in range(round(seconds / 0.008)):
        now = 1.0 + 0.008 * k
        if seen or k < 5:
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), AHEAD, now - 0.02))
        observed = observe(now, command=np.zeros(6))
        if permit:
            pressed = felt(-task.chase.give)
            observed.guard.permit = Permit(
                dock, task.dock.permit, PermitState.GRANTED, pressed=pressed
            )
        task.update(observed)
        by.append(-task.chase.give)
    return np.array(by), task


def test_a_tip_that_feels_nothing_goes_on_slowly_and_no_farther_than_stated():
    """A held ball was stood before by 7 mm for 7 s: the pair was wrong about its own place."""
    by, task = stood(5.0)
    assert by[: round(0.9 * STANDS / 0.008)].max() == 0.0
    steps = np.diff(by)
    assert steps.min() >= 0.0
    assert steps.max() <= 1.01 * CREEPS * 0.008
    assert by[-1] == docking("ball").creeps == 0.015
    assert task.face().reason == "felt nothing 15 mm behind where the surface should be"


def test_what_is_felt_ends_it_for_as_long_as_the_tip_is_there():
    by, task = stood(5.0, lambda by: 1.5 if by > 0.006 else 0.0)
    assert 0.006 < by.max() < 0.0065
    assert "nothing" not in task.face().reason


@pytest.mark.parametrize(
    "how",
    [
        {"felt": lambda by: math.nan},
        {"permit": False},
        {"standoff": 0.002},
        {"seen": False},
        {"dock": "bullseye"},
    ],
    ids=["no sensor", "no permit", "stand-off", "not seen", "one that does not"],
)
def test_nobody_goes_on_without_a_sensor_a_permit_or_a_look(how):
    by, _ = stood(3.0, **how)
    assert by.max() <= 0.0


def test_a_target_that_moves_is_begun_with_anew():
    creeping = Creeping(0.01)
    for k in range(200):
        creeping.update(0.008 * k, True, 0.0, 1.0)
    assert creeping.by > 0.005
    assert creeping.update(1.7, False, 0.0, 1.0) == 0.0
    assert creeping.update(1.71, True, 0.0, 1.0) == 0.0


def test_of_v_s_tasks_those_with_a_round_target_go_on():
    """What a flat thing's centre is touched at is its surface; nobody's face or palm is."""
    assert {name for name in DOCK_NAMES if docking(name).creeps > 0.0} == {"ball", "held_ball"}
