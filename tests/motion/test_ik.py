"""Inverse kinematics against forward kinematics, for every arm of the catalogue."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.motion.ik import _unwound, solve_ik
from armsight.robots import ROBOT_NAMES, load_robot, load_tool
from armsight.robots.kinematics import tcp_pose


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_reachable_poses_are_reached_within_the_limits(name):
    robot = load_robot(name)
    rng = np.random.default_rng(3)
    solved = 0
    for _ in range(100):
        truth = rng.uniform(robot.limits.lower, robot.limits.upper)
        T = tcp_pose(robot, truth)
        found = solve_ik(robot, T, robot.home, rng, wanted=2)
        solved += bool(found)
        for q in found:
            assert (q >= robot.limits.lower).all()
            assert (q <= robot.limits.upper).all()
            np.testing.assert_allclose(tcp_pose(robot, q), T, atol=2e-6)
    assert solved >= 99


def test_the_solution_nearest_to_the_seed_comes_first():
    robot = load_robot("ur5")
    rng = np.random.default_rng(0)
    truth = np.array([0.4, -1.2, 1.5, -1.8, -1.5, 0.3])
    found = solve_ik(robot, tcp_pose(robot, truth), truth + 0.05, rng, wanted=8)
    assert len(found) >= 4  # a UR arm has up to eight
    np.testing.assert_allclose(found[0], truth, atol=1e-5)
    distance = [np.abs(q - truth - 0.05).max() for q in found]
    assert distance == sorted(distance)


def test_whole_turns_make_no_other_solution():
    """They were counted among the wanted ones, and a UR arm's eight were three."""
    robot = load_robot("ur5")
    truth = np.array([0.4, -1.2, 1.5, -1.8, -1.5, 0.3])
    found = np.array(solve_ik(robot, tcp_pose(robot, truth), truth, np.random.default_rng(0)))
    assert len(found) == 8
    apart = np.abs(np.angle(np.exp(1j * (found[:, None] - found)))).max(axis=2)
    assert (apart + 9.0 * np.eye(8) > 1e-2).all()


def test_a_tool_moves_the_tip():
    bare = load_robot("ur5")
    robot = bare.with_tool(load_tool("gripper"))
    T = tcp_pose(robot, robot.home)
    assert not np.allclose(T, tcp_pose(bare, bare.home))
    q = solve_ik(robot, T, robot.home, np.random.default_rng(0))[0]
    np.testing.assert_allclose(tcp_pose(robot, q), T, atol=2e-6)


def test_out_of_reach_gives_nothing():
    robot = load_robot("ur5")
    far = make_pose(None, [3.0, 0.0, 0.0])
    assert solve_ik(robot, far, None, np.random.default_rng(0)) == []


@pytest.mark.parametrize("bad", [np.full((4, 4), np.nan), np.diag([1.0, 2.0, 1.0, 1.0]), np.eye(3)])
def test_what_is_no_pose_is_refused(bad):
    with pytest.raises(ValueError, match="rigid transform"):
        solve_ik(load_robot("ur5"), bad, None, np.random.default_rng(0))


def test_same_seed_same_solutions():
    robot = load_robot("panda")
    T = tcp_pose(robot, robot.home)
    a, b = (solve_ik(robot, T, None, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_turns_are_the_nearest_that_the_limits_allow():
    """By the seed's own turn alone a joint near its end was sent two turns away."""
    turn = 2.0 * np.pi
    rng = np.random.default_rng(2)
    for _ in range(200):
        lower, upper = -rng.uniform(0.1, 8.0, 6), rng.uniform(0.1, 8.0, 6)
        q, seed = rng.uniform(lower, upper), rng.uniform(lower, upper)
        every = q + turn * np.arange(-4, 5)[:, None]
        every = np.where((every >= lower) & (every <= upper), every, np.inf)
        nearest = np.abs(every - seed).min(axis=0)
        np.testing.assert_allclose(np.abs(_unwound(q, seed, lower, upper) - seed), nearest)


def test_a_mirrored_pose_is_no_pose():
    """It was sought a hundred times, and then called out of reach."""
    T = np.diag([1.0, 1.0, -1.0, 1.0])
    T[:3, 3] = 0.4, 0.1, 0.5
    with pytest.raises(ValueError, match="not a rigid transform"):
        solve_ik(load_robot("ur5"), T, None, np.random.default_rng(0))
