"""Each mistake of the design page injected into a good set is named; a good set is not blamed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armsight.calibration.calibrate import CalibrationOptions, calibrate
from armsight.calibration.diagnosis.raw_poses import RawPoses
from armsight.calibration.diagnosis.solved import diagnose_solution
from armsight.calibration.diagnosis.start import diagnose_start
from armsight.calibration.synthetic import (
    ErrorLevels,
    SheetCamera,
    make_cell,
    observe,
    random_views,
    t1_cameras,
)
from armsight.geometry.pose import exp, inverse

CAMERA = (
    SheetCamera("cam", t1_cameras()[0].lenses[1:], (np.eye(4),), t1_cameras()[0].T_base_camera),
)


@pytest.fixture(scope="module")
def good(arm5):
    rng = np.random.default_rng(21)
    levels = replace(ErrorLevels(), lens=0.0, wrong_boards=0.0)
    cell = make_cell(arm5, rng, levels, CAMERA)
    joints = random_views(cell, 14, rng)
    return cell, observe(cell, joints, rng)


def raw_of(problem, kind="quaternion"):
    T = np.array([v.T_base_flange for v in problem.views])
    R = Rotation.from_matrix(T[:, :3, :3])
    rotation = {
        "quaternion": R.as_quat(),
        "vector": R.as_rotvec(),
        "rpy": R.as_euler("xyz"),
        "matrix": T[:, :3, :3].reshape(-1, 9),
    }[kind]
    return RawPoses(T[:, :3, 3], rotation, kind)


def read(problem, raw):
    poses = raw.poses()
    views = tuple(replace(v, T_base_flange=T, joints=None) for v, T in zip(problem.views, poses))
    return replace(problem, views=views, robot=None)


def codes(problem, raw=None):
    return [f.code for f in diagnose_start(problem, 0, raw)]


def test_a_good_set_is_not_blamed(good):
    _, problem = good
    assert codes(problem, raw_of(problem)) == []


def test_inverted_poses(good):
    _, problem = good
    views = tuple(
        replace(v, T_base_flange=inverse(v.T_base_flange), joints=None) for v in problem.views
    )
    assert codes(replace(problem, views=views, robot=None)) == ["pose_inverted"]


def test_wrong_mount(good):
    _, problem = good
    hand = replace(
        problem,
        rigs=(replace(problem.rigs[0], mount="flange"),),
        boards=(replace(problem.boards[0], mount="base"),),
    )
    assert codes(hand) == ["pose_inverted"]


def test_millimetres(good):
    _, problem = good
    raw = raw_of(problem)
    raw = replace(raw, position=raw.position * 1e3)
    assert codes(read(problem, raw), raw) == ["millimetres"]


@pytest.mark.parametrize("factor", [25 / 30, 36 / 30, 1000.0])
def test_wrong_board_size(good, factor):
    _, problem = good
    board = replace(problem.boards[0], points=problem.boards[0].points * factor)
    expected = "millimetres" if factor == 1000.0 else "board_size"
    assert codes(replace(problem, boards=(board,))) == [expected]


def test_degrees(good):
    _, problem = good
    raw = raw_of(problem, "rpy")
    raw = replace(raw, rotation=np.rad2deg(raw.rotation))
    assert codes(read(problem, raw), raw) == ["degrees"]


def test_quaternion_order(good):
    _, problem = good
    raw = raw_of(problem)
    raw = replace(raw, rotation=raw.rotation[:, [3, 0, 1, 2]])
    assert codes(read(problem, raw), raw) == ["quaternion_order"]


def test_rotation_vectors_read_as_angles(good):
    _, problem = good
    raw = replace(raw_of(problem, "vector"), kind="rpy")
    assert codes(read(problem, raw), raw) == ["rotation_format"]


def test_transposed_matrices(good):
    _, problem = good
    raw = raw_of(problem, "matrix")
    raw = replace(raw, rotation=raw.rotation[:, [0, 3, 6, 1, 4, 7, 2, 5, 8]])
    assert codes(read(problem, raw), raw) == ["matrix_order"]


@pytest.mark.parametrize("shift", [1, -1])
def test_shifted_pairs(good, shift):
    _, problem = good
    n = len(problem.views)
    moved = tuple(
        replace(s, view=s.view + shift) for s in problem.sightings if 0 <= s.view + shift < n
    )
    assert codes(replace(problem, sightings=moved)) == ["shifted"]


def test_text_order(good):
    _, problem = good
    order = sorted(range(len(problem.views)), key=str)
    views = tuple(problem.views[i] for i in order)
    assert codes(replace(problem, views=views)) == ["order"]


def test_flipped_boards(good):
    _, problem = good
    wrong = tuple(
        replace(s, pixel=s.pixel[::-1]) if k in (2, 5, 6, 9) else s
        for k, s in enumerate(problem.sightings)
    )
    assert codes(replace(problem, sightings=wrong)) == ["flipped"]


def test_poses_of_another_day(good):
    _, problem = good
    rng = np.random.default_rng(0)
    order = rng.permutation(len(problem.views))
    views = tuple(problem.views[i] for i in order)
    assert codes(replace(problem, views=views)) == ["poses_do_not_match"]


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
    assert "distortion" in [f.code for f in diagnose_solution(result.solution, 0)]


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
    found = diagnose_solution(result.solution, 0)
    assert [f.code for f in found] == ["slip"]
    assert "and view 9" in found[0].message
    clean = calibrate(before, np.random.default_rng(0), options)
    assert diagnose_solution(clean.solution, 0) == []


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
