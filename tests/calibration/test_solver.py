"""Exact data give exact answers; frames and order do not matter."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration.calibrate import CalibrationOptions, calibrate
from armsight.calibration.closed_form import park, shah
from armsight.calibration.model import Model
from armsight.calibration.noise import solve_with_noise
from armsight.calibration.problem import ArmView, BoardPlacement, Freedom, Lens, Rig, Sighting
from armsight.calibration.solver import solve
from armsight.calibration.start import find_start
from armsight.calibration.synthetic import (
    ErrorLevels,
    make_cell,
    observe,
    random_views,
    target_error,
    true_flanges,
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


def test_what_begins_nowhere_does_not_end_well(exact):
    """A start whose cost is no number was said to have converged."""
    _, problem = exact
    model = Model(find_start(problem, np.random.default_rng(0)).problem, EXACT)
    state = model.start()
    state = replace(state, T_mount_board=state.T_mount_board * np.nan)
    assert not solve(model, state).converged


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


def test_poses_alone_can_be_solved(exact):
    """Lenses known, boards free in space: nothing is shared, each board finds its own pose."""
    _, problem = exact
    lenses = tuple(replace(lens, keep=True) for lens in problem.lenses[:1])
    boards = tuple(ArmView(np.eye(4), free=True) for _ in problem.views)
    seen = tuple(s for s in problem.sightings if s.lens == 0)
    frames = replace(problem, lenses=lenses, rigs=problem.rigs[:1], views=boards, sightings=seen)
    frames = replace(frames, robot=None)
    solution = answer(frames)
    assert solution.model.free.sum() == 0
    assert solution.rms_px() < 1e-6


def test_corners_on_other_things_do_not_count(arm5):
    """One corner of each board lies 40 px off: cut, it moves the answer no more than if unseen."""
    rng = np.random.default_rng(12)
    cell = make_cell(arm5, rng, ErrorLevels.ideal(0.1))
    problem = observe(cell, random_views(cell, 15, rng), rng)

    def shifted(s):
        pixel = s.pixel.copy()
        pixel[s.view % 24] += 40.0
        return replace(s, pixel=pixel)

    def without(s):
        keep = s.corner != s.view % 24
        return replace(s, corner=s.corner[keep], pixel=s.pixel[keep])

    free = replace(EXACT, shape=True)
    found = [
        solve_with_noise(
            find_start(
                replace(problem, sightings=tuple(change(s) for s in problem.sightings)),
                np.random.default_rng(0),
            ).problem,
            free,
        )[0]
        for change in (shifted, without)
    ]
    assert found[0].dropped == len(problem.sightings)
    np.testing.assert_allclose(found[0].state.T_mount_rig, found[1].state.T_mount_rig, atol=2e-5)


def test_noise_is_told_lens_by_lens_and_board_by_board(arm5):
    rng = np.random.default_rng(13)
    cell = make_cell(arm5, rng, replace(ErrorLevels.ideal(), corner_color=0.1, corner_infrared=0.3))
    problem = observe(cell, random_views(cell, 21, rng), rng)
    noisy = tuple(
        replace(s, pixel=s.pixel + rng.normal(0, 0.8, s.pixel.shape)) if s.view == 4 else s
        for s in problem.sightings
    )
    start = find_start(replace(problem, sightings=noisy), np.random.default_rng(0))
    solution, _ = solve_with_noise(start.problem, replace(EXACT, shape=True))
    sigma, lens = solution.model.sigma, solution.model.lens_of
    usual = solution.model.view_of != 4
    assert 0.24 < np.median(sigma[usual & (lens == 0)]) < 0.36
    assert 0.08 < np.median(sigma[usual & (lens == 1)]) < 0.12
    assert np.all(sigma[~usual] > 0.5)


def test_good_boards_far_out_are_kept_and_slipped_ones_named(arm5):
    """An arm with absolute errors and lenses off from their sheets: only mis-seen boards go."""
    rng = np.random.default_rng(14)
    cell = make_cell(arm5, rng, replace(ErrorLevels(), wrong_boards=0.0))
    problem = observe(cell, random_views(cell, 24, rng), rng)
    slipped = {(s.view, s.lens) for s in problem.sightings[5::40]}
    seen = tuple(
        replace(s, pixel=s.pixel + s.pixel[1] - s.pixel[0]) if (s.view, s.lens) in slipped else s
        for s in problem.sightings
    )
    options = CalibrationOptions(left_out=False)
    result = calibrate(replace(problem, sightings=seen), np.random.default_rng(0), options)
    assert {(s.view, s.lens) for s, _ in result.rejected} == slipped


def test_one_calibration_for_cameras_beside_and_on_the_arm(arm5):
    """Eye to hand and eye in hand at once: one board on the flange, another one on the table."""
    rng = np.random.default_rng(15)
    cell = make_cell(arm5, rng, ErrorLevels.ideal(0.1))
    joints = random_views(cell, 24, rng)
    seen = observe(cell, joints, rng)
    flanges = true_flanges(cell, joints, None)
    # A wrist camera looks along the flange; its board lies where it is seen in the first views.
    lens = cell.sheet.lenses[1].camera
    T_flange_wrist = exp([0.05, 0.0, 0.03, 0.05, -0.04, 0.6])
    points = cell.points
    T_base_table = flanges[0] @ T_flange_wrist @ exp([-0.08, -0.05, 0.7, 0.3, -0.2, 0.1])
    wrist = []
    for v, T in enumerate(flanges):
        p = inverse(T @ T_flange_wrist) @ T_base_table
        p = points @ p[:3, :3].T + p[:3, 3]
        if p[:, 2].min() < 0.2:
            continue
        pixel = lens.project(p)
        if pixel.min() < 0 or np.any(pixel.max(0) > [lens.width, lens.height]):
            continue
        noise = rng.normal(0, 0.1, pixel.shape)
        wrist.append(Sighting(v, len(seen.lenses), 1, np.arange(len(p)), pixel + noise, 0.1))
    assert len(wrist) >= 4
    both = replace(
        seen,
        rigs=(*seen.rigs, Rig("wrist", "flange")),
        lenses=(*seen.lenses, Lens("wrist", 3, lens, keep=True)),
        boards=(*seen.boards, BoardPlacement("table", points, "base")),
        sightings=(*seen.sightings, *wrist),
    )
    solution = answer(both)
    np.testing.assert_allclose(solution.state.T_mount_rig[3], T_flange_wrist, atol=2e-3)
    np.testing.assert_allclose(solution.state.T_mount_board[1], T_base_table, atol=3e-3)
    np.testing.assert_allclose(solution.state.T_mount_rig[:3], cell.state.T_mount_rig, atol=2e-3)
