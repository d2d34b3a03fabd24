"""What keeps the tip from its target is said in words, and given up after a stated time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.quick_cell import VOXEL
from armsight.experiments.servo_ball import path_of
from armsight.experiments.servo_eyes import Errors
from armsight.experiments.servo_world import (
    FAR,
    Trial,
    make_eyes,
    make_task,
    set_up,
    world_to_base,
)
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.ik import solve_ik
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.aim import Aim, Weights, aim_pose
from armsight.servoing.ceiling import Ceiling
from armsight.servoing.docking import docking
from armsight.servoing.hindrance import Hindrance, Reach
from armsight.servoing.modes import tool_direction
from armsight.tasks.servo import chase_config

SETUP = set_up(1.0, 1.0)
CONFIG = chase_config(SETUP.workcell, SETUP.workcell.robot.T_world_base, docking("ball"))
WAITED = 3.0


def aim_at(place):
    axis, down = tool_direction(CONFIG, place, None)
    return Aim(place - 0.04 * axis, np.zeros(3), axis, down)


def reach(robot=SETUP.robot, ceiling=None):
    return Reach(robot, Weights(), ceiling)


def test_no_place_that_the_arm_can_be_brought_to_is_said_to_be_out_of_reach():
    """By another solver, from a hundred places; none that is farther away than the arm is long is
    missed."""
    rng, reaches, judged = np.random.default_rng(2), reach(), []
    robot = SETUP.robot
    tip = robot.T_last_flange @ robot.tool.T_flange_tcp
    offsets = [np.linalg.norm(T[:3, 3]) for T in robot.T_link_joint[1:]]
    length = sum(offsets) + np.linalg.norm(tip[:3, 3])
    for k in range(60):
        place = rng.uniform((-0.6, -1.0, 0.1), (2.6, 1.0, 1.1))
        aim = aim_at(place)
        out = reaches.fault(aim, robot.home).startswith("out of reach")
        if solve_ik(robot, aim_pose(aim), None, np.random.default_rng(k), wanted=1):
            assert not out
        elif np.linalg.norm(aim.position - robot.T_link_joint[0][:3, 3]) > length:
            assert out
        judged.append(out)
    assert 10 < sum(judged) < 50


def test_a_joint_at_its_limit_is_named():
    limits = SETUP.robot.limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[0], upper[0] = np.deg2rad((-60.0, -25.0))
    robot = replace(SETUP.robot, limits=replace(limits, lower=lower, upper=upper))
    place = np.array([0.6, 0.7, 0.7])
    assert reach().fault(aim_at(place), robot.home) == ""
    words = reach(robot).fault(aim_at(place), robot.home)
    assert words.startswith("out of reach: no joints bring the tip there")
    assert "shoulder_pan_joint at its limit of -25 deg" in words


def test_an_arm_that_would_touch_itself_there_says_with_what():
    """Both parts are named, and their spheres overlap in the pose that was found."""
    place = world_to_base(SETUP, [[0.27, 0.05, 1.32]])[0]
    words = reach().fault(aim_at(place), SETUP.robot.home)
    assert "touch itself" in words or "pointing as it has to" in words


def test_below_the_top_of_what_is_mapped_is_said():
    place = world_to_base(SETUP, [[0.8, 0.0, 1.9]])[0]
    top = Ceiling(CONFIG.vertical, 0.05)
    assert reach().fault(aim_at(place), SETUP.robot.home) == ""
    assert "below the top of what is mapped" in reach(ceiling=top).fault(
        aim_at(place), SETUP.robot.home
    )


def test_who_comes_nearer_or_is_waited_for_is_not_held_up():
    held, aim = Hindrance(reach()), aim_at(np.array([0.85, 0.0, 0.7]))
    home = SETUP.robot.home
    for k in range(1000):  # 2 cm/s
        assert held.update(0.008 * k, 0.5 - 0.02 * 0.008 * k, aim, home, None, True) == ""
    for k in range(1000, 2000):  # refused: the permit's own words say why
        assert held.update(0.008 * k, 0.3, aim, home, None, False) == ""
    words = held.update(16.1, 0.3, aim, home, None, True)
    assert words.startswith("held up on its way")
    assert held.update(16.2, 0.01, aim, home, None, True) == ""


def trial(place, path=None):
    eyes = make_eyes(SETUP, Errors(), np.random.default_rng((1, 1)))
    task = make_task(SETUP, "ours")
    task.patience.seconds = WAITED
    return Trial(SETUP, eyes, task, path or (lambda t: place), SETUP.robot.home)


def stood(run, seconds=1.0):
    """Whether the arm was at rest at the end."""
    return np.abs(run.course.commands[-round(seconds / 0.008) :]).max() < 1e-6


def test_a_ball_a_metre_beyond_reach_is_given_up_in_words():
    run = trial(world_to_base(SETUP, [[2.4, 0.1, 1.25]])[0])
    said = ""
    while run.now < WAITED + 3.0:
        run.step()
        face = run.task.face()
        if 1.0 < run.now < WAITED:
            assert face.reason.startswith("out of reach: no joints bring the tip there")
        said = face.reason
    assert said.startswith("gave up after 3 s: out of reach")
    assert stood(run)


def wall(run, place):
    """A solid board of 0.8 m before a place, in the map."""
    cell = run.cell
    index = np.indices(cell.grid.shape).reshape(3, -1).T
    away = cell.grid.center(index) - (place - (0.12, 0.0, 0.0))
    filled = cell.state == OCCUPIED
    filled[tuple(index[(np.abs(away) < (0.03, 0.4, 0.4)).all(axis=1)].T)] = True
    cell.state[filled] = OCCUPIED
    cell.field = bounded_distance(filled.astype(np.uint8), VOXEL, FAR)


def test_a_ball_behind_a_board_is_given_up_in_words_and_the_board_is_not_touched():
    place = world_to_base(SETUP, [[0.85, 0.1, 1.25]])[0]
    run = trial(place)
    wall(run, place)
    reasons = set()
    while run.now < WAITED + 6.0:
        run.step()
        reasons.add(run.task.face().reason)
        assert tcp_pose(SETUP.robot, run.cell.q)[0, 3] < place[0] - 0.12 - 0.03
    (gave,) = [r for r in reasons if r.startswith("gave up")]
    assert "no way around what is before it: wrist_3_link touches something near (0.7" in gave
    assert stood(run)


def test_a_ball_that_wanders_within_reach_is_followed_without_such_words():
    rng = np.random.default_rng(3)
    path = path_of(world_to_base(SETUP, [[0.85, 0.0, 1.25]])[0], 0.2, rng)
    run = trial(None, path)
    while run.now < 5.0:
        run.step()
        assert "out of reach" not in run.task.face().reason
        assert "held up" not in run.task.face().reason
    assert run.task.touches


@pytest.mark.parametrize("mode", ["paper", "fixed"])
def test_v_s_modes_say_it_too(mode):
    place = world_to_base(SETUP, [[2.4, 0.1, 1.25]])[0]
    eyes = make_eyes(SETUP, Errors(), np.random.default_rng((1, 1)))
    run = Trial(SETUP, eyes, make_task(SETUP, mode), lambda t: place, SETUP.robot.home)
    run.run(1.5)
    assert run.task.face().reason.startswith("out of reach")
