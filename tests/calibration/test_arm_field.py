"""Errors that similar poses share: the process against its limits, and against unseen views."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import ur5

from armsight.calibration import se3
from armsight.calibration.arm_field import CLEAR, Sizes, fit_field, measure, posterior
from armsight.calibration.calibrate import Calibration
from armsight.calibration.noise import WHITE, exact_arm, solve_with_noise
from armsight.calibration.peers import compare
from armsight.calibration.problem import Freedom, Mount, Problem
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import problem_of, solve_set
from armsight.calibration.synthetic_set import (
    LENS,
    ArmErrors,
    SyntheticSet,
    make_set,
    seen_from,
)
from armsight.experiments.calibration_layouts import PlainSet, write_corners
from armsight.experiments.calibration_mistakes import BOARD


def _folder(place: Path, one: SyntheticSet) -> Path:
    every = np.arange(len(one.points))
    plain = PlainSet(one.told, tuple((every, p) for p in one.pixels), (LENS.width, LENS.height))
    write_corners(place, plain)
    rows = [" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told]
    (place / "poses.txt").write_text("\n".join(rows) + "\n")
    return place


def _problem(place: Path, mount: Mount, errors: ArmErrors, views: int) -> Problem:
    one = make_set(ur5(), np.random.default_rng(12), views, mount, errors)
    return problem_of(load(_folder(place, one), BOARD))


def test_without_smooth_errors_it_is_the_usual_least_squares(tmp_path: Path) -> None:
    problem = _problem(tmp_path, "base", ArmErrors(5e-4, 0.0), 9)
    solution, freedom = solve_with_noise(problem, Freedom(lens=True, shape=False, white=WHITE))
    assert freedom.white is not None
    measured, _ = measure(solution)
    found = posterior(measured, Sizes((1e-9, 1e-9), freedom.white, 0.3))
    usual = np.linalg.inv(solution.normal.reduced())
    np.testing.assert_allclose(
        np.diagonal(found.covariance), np.diagonal(usual), rtol=0.03, atol=1e-12
    )
    # The answer was one already: a step of a small part of its sigma.
    assert np.abs(found.step / np.sqrt(np.diagonal(usual))).max() < 0.1


def test_an_arm_without_errors_is_told_as_one(tmp_path: Path) -> None:
    problem = _problem(tmp_path, "flange", ArmErrors(0.0, 0.0), 12)
    solution, freedom = solve_with_noise(problem, Freedom(lens=True, shape=False, white=WHITE))
    exact, rigid = exact_arm(solution, freedom)
    assert rigid.white is None
    np.testing.assert_allclose(exact.state.E, np.broadcast_to(np.eye(4), exact.state.E.shape))
    assert fit_field(exact) is None


def test_an_arm_with_errors_is_not_told_as_exact(tmp_path: Path) -> None:
    problem = _problem(tmp_path, "flange", ArmErrors(2e-4, 0.0), 12)
    solution, freedom = solve_with_noise(problem, Freedom(lens=True, shape=False, white=WHITE))
    assert exact_arm(solution, freedom) == (solution, freedom)


@pytest.fixture(scope="module")
def bending(tmp_path_factory: pytest.TempPathFactory) -> tuple[SyntheticSet, Calibration]:
    """A set whose arm errs by some millimetres that grow with the square of the reach."""
    one = make_set(ur5(), np.random.default_rng(5), 24, "base", ArmErrors(0.0, 0.0))
    at = one.told[:, :3, 3] - one.told[:, :3, 3].mean(0)
    error = np.zeros((one.views, 6))
    error[:, :3] = 0.06 * at[:, [1, 2, 0]] * at + 0.01 * at[:, [2, 0, 1]]
    error[:, 3:] = 0.02 * at
    true = one.told @ se3.exps(error)
    noise = np.random.default_rng(6).normal(0, 0.1, one.pixels.shape)
    pixels = seen_from(one, true, one.T_mount_camera, one.T_mount_board) + noise
    one = replace(one, true=true, pixels=pixels)
    answer = solve_set(load(_folder(tmp_path_factory.mktemp("set"), one), BOARD)).calibration
    assert answer is not None
    return one, answer


def test_errors_that_may_as_well_be_independent_move_nothing(tmp_path: Path) -> None:
    problem = _problem(tmp_path, "base", ArmErrors(1e-3, 0.0), 14)
    solution, _ = solve_with_noise(problem, Freedom(lens=True, shape=False, white=WHITE))
    field = fit_field(solution)
    assert field is not None
    assert field.gain < CLEAR
    assert field.solution is solution


def test_errors_that_are_clearly_alike_move_the_answer(
    bending: tuple[SyntheticSet, Calibration],
) -> None:
    _, answer = bending
    assert answer.field is not None
    assert answer.field.gain > CLEAR
    assert answer.field.solution is not answer.field.before


def test_views_are_foreseen_from_their_neighbours(
    bending: tuple[SyntheticSet, Calibration],
) -> None:
    _, answer = bending
    assert answer.field is not None
    peers = {p.name: p.mm for p in compare(answer)}
    ours = peers.pop("armsight")
    assert ours < 0.6 * min(peers.values())


def test_the_ellipsoid_of_a_bending_arm_holds_the_truth(
    bending: tuple[SyntheticSet, Calibration],
) -> None:
    one, answer = bending
    d = se3.logs(se3.inverses(answer.camera_pose(0)[None]) @ one.T_mount_camera)[0]
    assert d @ np.linalg.solve(answer.covariance.camera_pose(0), d) < 12.592
    # ... and is not merely large: a point is known to less than the arm errs by ten times.
    assert answer.target_sigma(0) < 0.02
