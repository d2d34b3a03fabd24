"""Exact data give exact answers; frames and order do not matter."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration.closed_form import park, shah
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom
from armsight.calibration.solver import solve
from armsight.calibration.start import find_start
from armsight.calibration.synthetic import (
    ErrorLevels,
    make_cell,
    observe,
    random_views,
    target_error,
)
from armsight.geometry.pose import exp, inverse

EXACT = Freedom(lens=False, shape=False, robot=False, white=None)


@pytest.fixture(scope="module")
def exact(arm5):
    rng = np.random.default_rng(11)
    cell = make_cell(arm5, rng, ErrorLevels.ideal(corner=1e-9))
    joints = random_views(cell, 9, rng)
    return cell, observe(cell, joints, rng)


def answer(problem, freedom=EXACT, seed=0):
    start = find_start(problem, np.random.default_rng(seed))
    return solve(Model(start.problem, freedom))


def test_exact_data_give_the_truth(exact):
    cell, problem = exact
    solution = answer(problem)
    assert solution.converged
    np.testing.assert_allclose(solution.state.T_mount_rig, cell.state.T_mount_rig, atol=1e-9)
    np.testing.assert_allclose(solution.state.T_mount_board, cell.state.T_mount_board, atol=1e-9)
    assert max(target_error(cell, solution.state, k) for k in range(6)) < 1e-8


def test_lens_and_arm_come_back_too(arm5):
    rng = np.random.default_rng(2)
    levels = ErrorLevels(1e-4, 1e-4, 0, 0, (0, 0), 1.0, 0.0, 0.0, 1.0)
    cell = make_cell(arm5, rng, levels)
    problem = observe(cell, random_views(cell, 30, rng), rng)
    found = answer(problem, Freedom(lens=True, shape=False, robot=True, white=(1e-6, 1e-6)))
    before = answer(problem)
    for k in range(6):
        assert target_error(cell, found.state, k) < 0.1 * target_error(cell, before.state, k)


def test_closed_forms_are_exact_on_exact_poses(rng):
    A = np.array([exp(x) for x in rng.normal(0, 0.8, (8, 6))])
    X, Z = exp(rng.normal(0, 1, 6)), exp(rng.normal(0, 0.5, 6))
    C = np.array([inverse(X) @ a @ Z for a in A])
    for method in (park, shah):
        found_X, found_Z = method(A, C)
        np.testing.assert_allclose(found_X, X, atol=1e-9)
        np.testing.assert_allclose(found_Z, Z, atol=1e-9)


def test_moving_the_base_moves_the_cameras_likewise(exact):
    _, problem = exact
    M = exp([0.3, -0.2, 0.1, 0.4, 0.3, -1.0])
    moved = replace(
        problem,
        robot=None,
        views=tuple(
            replace(v, T_base_flange=M @ v.T_base_flange, joints=None) for v in problem.views
        ),
    )
    a, b = answer(problem).state, answer(moved).state
    np.testing.assert_allclose(b.T_mount_rig, M @ a.T_mount_rig, atol=1e-8)
    np.testing.assert_allclose(b.T_mount_board, a.T_mount_board, atol=1e-8)


def test_moving_the_flange_frame_moves_the_board_likewise(exact):
    _, problem = exact
    M = exp([0.03, -0.02, 0.1, 0.4, 0.3, -1.0])
    moved = replace(
        problem,
        robot=None,
        views=tuple(
            replace(v, T_base_flange=v.T_base_flange @ M, joints=None) for v in problem.views
        ),
    )
    a, b = answer(problem).state, answer(moved).state
    np.testing.assert_allclose(b.T_mount_rig, a.T_mount_rig, atol=1e-8)
    np.testing.assert_allclose(b.T_mount_board, inverse(M) @ a.T_mount_board, atol=1e-8)


def test_order_does_not_matter(exact):
    _, problem = exact
    n = len(problem.views)
    order = np.random.default_rng(1).permutation(n)
    place = np.argsort(order)
    shuffled = replace(
        problem,
        views=tuple(problem.views[i] for i in order),
        sightings=tuple(replace(s, view=int(place[s.view])) for s in reversed(problem.sightings)),
    )
    a, b = answer(problem).state, answer(shuffled).state
    np.testing.assert_allclose(a.T_mount_rig, b.T_mount_rig, atol=1e-9)


def test_a_camera_on_the_arm_is_the_same_problem_backwards(exact):
    """Eye in hand: the same sightings with every arm pose inverted and the mounts exchanged."""
    _, problem = exact
    hand = replace(
        problem,
        robot=None,
        rigs=tuple(replace(r, mount="flange") for r in problem.rigs),
        boards=tuple(replace(b, mount="base") for b in problem.boards),
        views=tuple(
            replace(v, T_base_flange=inverse(v.T_base_flange), joints=None) for v in problem.views
        ),
    )
    a, b = answer(problem).state, answer(hand).state
    np.testing.assert_allclose(a.T_mount_rig, b.T_mount_rig, atol=1e-8)
    np.testing.assert_allclose(a.T_mount_board, b.T_mount_board, atol=1e-8)


def test_mis_seen_boards_and_corners_hardly_matter(arm5):
    rng = np.random.default_rng(4)
    levels = replace(ErrorLevels.ideal(0.2), wrong_boards=0.15, outliers=0.05)
    cell = make_cell(arm5, rng, levels)
    problem = observe(cell, random_views(cell, 20, rng), rng)
    solution = answer(problem)
    assert max(target_error(cell, solution.state, k) for k in range(6)) < 1.5e-3
