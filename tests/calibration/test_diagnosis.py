"""Mistakes that views and residuals tell; the rest of the mistakes stand in test_mistakes.py."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.calibration import se3
from armsight.calibration.calibrate import CalibrationOptions, calibrate
from armsight.calibration.diagnosis.slip import find_slip
from armsight.calibration.diagnosis.solved import diagnose_solution
from armsight.calibration.diagnosis.start import diagnose_start
from armsight.calibration.pose_space import PoseErrors, with_arm_scatter
from armsight.calibration.synthetic import (
    ErrorLevels,
    SheetCamera,
    make_cell,
    observe,
    random_views,
    t1_cameras,
)
from armsight.geometry.pose import exp

CAMERA = (
    SheetCamera("cam", t1_cameras()[0].lenses[1:], (np.eye(4),), t1_cameras()[0].T_base_camera),
)
NAMES = [f"{k}.png" for k in range(40)]


@pytest.fixture(scope="module")
def good(arm5):
    rng = np.random.default_rng(21)
    levels = replace(ErrorLevels(), lens=0.0, wrong_boards=0.0)
    cell = make_cell(arm5, rng, levels, CAMERA)
    joints = random_views(cell, 14, rng)
    return cell, observe(cell, joints, rng)


def codes(problem):
    return [f.code for f in diagnose_start(problem, 0)]


def test_a_good_set_is_not_blamed(good):
    assert codes(good[1]) == []


def test_lens_of_another_resolution(good):
    _, problem = good
    lens = problem.lenses[0]
    for factor in (0.5, 2.0):
        camera = replace(lens.camera.scaled(factor), width=1920, height=1080)
        given = replace(lens, camera=camera, keep=True, prior=None)
        assert "lens_resolution" in codes(replace(problem, lenses=(given,)))


def test_missing_distortion(arm5):
    rng = np.random.default_rng(3)
    cell = make_cell(arm5, rng, replace(ErrorLevels(), lens=0.0), CAMERA)
    bent = cell.state.lens.copy()
    bent[0, 4:] = (0.12, -0.25, 0.0, 0.0, 0.09)
    cell = replace(cell, state=replace(cell.state, lens=bent))
    problem = observe(cell, random_views(cell, 15, rng), rng)
    bare = replace(problem.lenses[0].camera, distortion=(0.0,) * 5)
    problem = replace(problem, lenses=(replace(problem.lenses[0], camera=bare, keep=True),))
    result = calibrate(problem, rng, CalibrationOptions(False, left_out=False))
    assert "distortion" in [f.code for f in diagnose_solution(result, 0, NAMES)]


def test_slip(arm5):
    rng = np.random.default_rng(8)
    cell = make_cell(arm5, rng, replace(ErrorLevels(), lens=0.0, wrong_boards=0.0), CAMERA)
    joints = random_views(cell, 16, rng)
    before = observe(cell, joints, rng)
    board = cell.state.T_mount_board @ exp([0.004, 0, 0.002, 0, 0.01, 0])
    after = observe(replace(cell, state=replace(cell.state, T_mount_board=board)), joints, rng)
    mixed = tuple(s for s in before.sightings if s.view < 9)
    mixed += tuple(s for s in after.sightings if s.view >= 9)
    problem = replace(before, sightings=mixed)
    options = CalibrationOptions(False, left_out=False)
    result = calibrate(problem, np.random.default_rng(0), options)
    found = [f for f in diagnose_solution(result, 0, NAMES) if f.code == "slip"]
    assert "the board seems to have moved between 8.png and 9.png" in found[0].message
    assert found[0].severity == "warning"
    clean = calibrate(before, np.random.default_rng(0), options)
    assert [f.code for f in diagnose_solution(clean, 0, NAMES)] == []


@pytest.mark.parametrize("drift", [False, True])
def test_an_arm_that_errs_is_no_slip(drift, rng):
    """Errors of a millimetre, independent or drifting slowly: nothing moved between two views."""
    for _ in range(20):
        n = int(rng.integers(8, 41))
        e = rng.normal(0, 1e-3, (n, 6))
        if drift:
            e = np.cumsum(e, axis=0) * 0.3 + 0.5 * e
        A = np.array([exp(rng.normal(0, 0.5, 6)) for _ in range(n)])
        design = np.concatenate(
            [np.tile(np.eye(6), (n, 1, 1)), se3.adjoints(se3.inverses(A))], axis=2
        )
        seen = np.tile(1e-8 * np.eye(6), (n, 1, 1))
        errors = with_arm_scatter(PoseErrors(np.arange(n), e, seen, np.zeros((6, 6)), design))
        assert find_slip(errors, rng) is None


def test_one_axis_few_and_alike(good):
    _, problem = good
    assert codes(problem.only_views([0, 1])) == ["few_views"]
    still = replace(problem.views[0], joints=None)
    views = tuple(
        replace(still, T_base_flange=still.T_base_flange @ exp([0.01 * k, 0, 0, 0, 0, 0]))
        for k in range(len(problem.views))
    )
    assert "alike" in codes(replace(problem, views=views, robot=None))
    views = tuple(
        replace(still, T_base_flange=still.T_base_flange @ exp([0, 0.01 * k, 0, 0, 0, 0.1 * k]))
        for k in range(len(problem.views))
    )
    assert "one_axis" in codes(replace(problem, views=views, robot=None))
