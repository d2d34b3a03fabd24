"""Folders as other labs ship them: drawn-on copies, depth maps, lenses' frames, joint angles."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from armsight.arrays import Bytes, Pose
from armsight.calibration.boards import CharucoBoard, parse_board
from armsight.calibration.boards.settle import settle_board
from armsight.calibration.diagnosis.joints import with_agreeing_joints
from armsight.calibration.layouts.folder import list_folder, pose_tables
from armsight.calibration.layouts.lens_choice import given_lens
from armsight.calibration.layouts.series import series_of
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic_picture import board_picture
from armsight.calibration.synthetic_set import LENS, ArmErrors, SyntheticSet, make_set
from armsight.errors import CalibrationError
from armsight.experiments.calibration_layouts import PlainSet, write_corners
from armsight.experiments.calibration_mistakes import BOARD
from armsight.experiments.calibration_stranger_runs import plain
from armsight.geometry.pose import look_at, make_pose, to_quaternion
from armsight.robots import load_robot


@pytest.fixture(scope="module")
def one() -> SyntheticSet:
    return make_set(load_robot("ur5"), np.random.default_rng(3), 14, "flange", ArmErrors(5e-5, 0))


def _plain(one: SyntheticSet) -> PlainSet:
    every = np.arange(len(one.points))
    return PlainSet(one.told, tuple((every, p) for p in one.pixels), (LENS.width, LENS.height))


def _scene(rng: np.random.Generator) -> Bytes:
    coarse = rng.integers(0, 255, (12, 16)).astype(np.uint8)
    return np.asarray(cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC), np.uint8)


def test_drawn_on_copies_and_depth_maps_are_no_cameras(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for k in range(4):
        scene = _scene(rng)
        cv2.imwrite(str(tmp_path / f"{k:03d}_image.jpg"), scene)
        drawn = cv2.circle(cv2.cvtColor(scene, cv2.COLOR_GRAY2BGR), (160, 120), 30, (0, 0, 255), 2)
        cv2.imwrite(str(tmp_path / f"{k:03d}_image_charuco.jpg"), drawn)
        deep = (500 + scene.astype(np.uint16)) * 4
        cv2.imwrite(str(tmp_path / f"{k:03d}_image.png"), deep)
    series, aside = series_of(tmp_path, sorted(tmp_path.iterdir()))
    assert [sorted(f.name for f in s.files) for s in series] == [
        [f"{k:03d}_image.jpg" for k in range(4)]
    ]
    assert len(aside) == 8


def test_two_cameras_of_one_folder_are_two(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for k in range(4):
        for side in ("left", "right"):
            cv2.imwrite(str(tmp_path / f"{side}_{k}.png"), _scene(rng))
    series, aside = series_of(tmp_path, sorted(tmp_path.iterdir()))
    assert sorted(s.name for s in series) == ["left", "right"]
    assert not aside


def test_the_boards_own_poses_are_not_the_arms(one: SyntheticSet, tmp_path: Path) -> None:
    write_corners(tmp_path, _plain(one))
    A = np.linalg.inv(one.told)
    C = np.linalg.inv(one.T_mount_camera) @ A @ one.T_mount_board
    for name, T in (("board", C), ("robot", one.told)):
        rows = "\n".join(" ".join(f"{v:.8f}" for v in M.ravel()) for M in T)
        (tmp_path / f"{name}.txt").write_text(rows + "\n")
    found = load(tmp_path, BOARD)
    assert found.poses is not None
    np.testing.assert_allclose(found.poses, one.told, atol=1e-6)
    assert [f.severity for f in found.findings if f.code == "board_poses"] == ["note"]
    (tmp_path / "robot.txt").unlink()
    alone = solve_set(load(tmp_path, BOARD))
    assert alone.calibration is None
    assert [f.severity for f in alone.findings if f.code == "board_poses"] == ["error"]


def test_joint_angles_are_poses_with_the_arms_model(one: SyntheticSet, tmp_path: Path) -> None:
    write_corners(tmp_path, _plain(one))
    rows = "\n".join(", ".join(f"{v:.9f}" for v in q) for q in one.joints)
    (tmp_path / "hand_angle.txt").write_text(rows + "\n")
    found = load(tmp_path, BOARD, robot=load_robot("ur5"))
    assert found.poses is not None
    assert found.joints is not None
    np.testing.assert_allclose(found.poses, one.told, atol=1e-6)
    without = solve_set(load(tmp_path, BOARD))
    assert without.calibration is None
    assert any("--robot" in f.cure for f in without.findings)


def test_a_camera_of_other_pictures_is_left_out(one: SyntheticSet, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    views = np.linalg.inv(one.T_mount_camera) @ np.linalg.inv(one.true) @ one.T_mount_board
    for k in range(6):
        for folder, T in (("hand", views[k]), ("lens", views[(3 * k + 7) % 14])):
            (tmp_path / folder).mkdir(exist_ok=True)
            picture = board_picture(BOARD, one.camera, T, rng, samples=2)
            cv2.imwrite(str(tmp_path / folder / f"{k}.png"), picture)
    rows = "\n".join(" ".join(f"{v:.8f}" for v in M.ravel()) for M in one.told[:6])
    (tmp_path / "poses.txt").write_text(rows + "\n")
    found = load(tmp_path, BOARD)
    assert [c.name for c in found.cameras] == ["hand"]
    assert [f.code for f in found.findings if f.severity == "warning"] == ["unused_camera"]


def test_one_file_that_holds_no_pose_is_named(one: SyntheticSet, tmp_path: Path) -> None:
    for k, T in enumerate(one.told):
        text = "\n".join(" ".join(f"{v:.8f}" for v in row) for row in T)
        (tmp_path / f"pose_{k}.txt").write_text("lost" if k == 4 else text)
    tables, unread = pose_tables(list_folder(tmp_path), 14)
    assert [len(t.values) for t in tables] == [13]
    assert [u.file.name for u in unread] == ["pose_4.txt"]


def test_python_objects_are_not_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "poses.npy", np.array([{"x": 1}], dtype=object), allow_pickle=True)
    tables, unread = pose_tables(list_folder(tmp_path), 10)
    assert not tables
    assert "holds Python objects" in unread[0].reason


@pytest.mark.parametrize("layout", ["ost.txt", "lens.npz", "lens.json", "param.txt"])
def test_lenses_in_other_files(layout: str, tmp_path: Path) -> None:
    K = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1]])
    d = np.array(LENS.distortion)
    file = tmp_path / layout
    rows = "\n".join(" ".join(f"{v:.6f}" for v in row) for row in K)
    bent = " ".join(f"{v:.6f}" for v in d)
    if layout == "ost.txt":
        file.write_text(
            f"# oST version 5.0 parameters\n\n[image]\n\nwidth\n1280\n\nheight\n960\n\n[cam]\n\n"
            f"camera matrix\n{rows}\n\ndistortion\n{bent}\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n"
        )
    elif layout == "param.txt":
        file.write_text("\n".join(f"{v:.6f}" for v in [*K.ravel(), *d]) + "\n")
    elif layout == "lens.npz":
        np.savez(file, mtx=K, dist=d[None])
    else:
        file.write_text(json.dumps({"intrinsic": K.tolist(), "distortion": [d.tolist()]}))
    found = given_lens([file], None, "camera", (1280, 960), 1).lens
    assert found is not None
    assert found.bent
    np.testing.assert_allclose(found.camera.K, K, atol=1e-5)
    np.testing.assert_allclose(found.camera.distortion, d, atol=1e-5)


def test_a_lens_of_another_model_is_named_and_not_used(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(
        "image_width: 1280\nimage_height: 960\ndistortion_model: equidistant\n"
        "camera_matrix: {data: [1000, 0, 640, 0, 1000, 480, 0, 0, 1]}\n"
    )
    found = given_lens([file], None, "camera", (1280, 960), 1)
    assert found.lens is None
    assert [f.code for f in found.findings] == ["lens_model"]
    assert "camera.yaml: distortion model 'equidistant'" in found.findings[0].message


def test_boards_named_a_little_wrongly_are_found() -> None:
    true = CharucoBoard(5, 7, 0.036, 0.027, "DICT_4X4_50")
    rng = np.random.default_rng(2)
    T = np.linalg.inv(look_at((0.12, 0.08, -0.5), (0.09, 0.126, 0.0), (0, -1, 0)))
    gray = board_picture(true, LENS, T, rng, samples=2)
    found, said = settle_board(parse_board("charuco:7x5:36:27:DICT_6X6_250"), [gray])
    assert isinstance(found, CharucoBoard)
    assert (found.columns, found.rows, found.dictionary) == (5, 7, "DICT_4X4_1000")
    assert "5 across and 7 down" in said[0].message
    assert settle_board(true, [gray]) == (true, [])


def test_a_count_that_is_wrong_altogether_is_read_and_said() -> None:
    true = parse_board("checkerboard:8x6:30")
    rng = np.random.default_rng(6)
    views = [((0.16, 0.08, -0.5), (0.09, 0.06, 0.0)), ((0.0, 0.12, -0.6), (0.08, 0.05, 0.0))]
    grays = [
        board_picture(true, LENS, np.linalg.inv(look_at(a, b, (0, -1, 0))), rng, samples=2)
        for a, b in views
    ]
    found, (said,) = settle_board(parse_board("checkerboard:10x7:30"), grays, lambda: grays)
    assert found.describe() == true.describe()
    assert said.severity == "warning"
    assert "no picture shows 9x6 inner corners, 2 of 2 show 7x5" in said.message
    # Where no picture shows any board, the named one stays.
    empty = [np.full((480, 640), 128, np.uint8)] * 3
    assert settle_board(true, empty, lambda: empty) == (true, [])


def test_no_board_at_all_says_what_was_looked_for(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), _scene(rng))
    (tmp_path / "poses.txt").write_text("\n".join("1 2 3 0 0 0" for _ in range(3)))
    with pytest.raises(CalibrationError, match="in any of 3 pictures"):
        solve_set(load(tmp_path, BOARD))


@pytest.mark.parametrize(
    ("base", "tool", "robot", "unit", "code", "with_joints"),
    [
        (np.eye(4), np.eye(4), "ur5", 1.0, "", True),
        (np.eye(4), np.eye(4), "ur5", 180 / np.pi, "", True),  # degrees that nobody names
        (np.eye(4), make_pose(None, [0.02, 0, 0.15]), "ur5", 1.0, "tool_poses", True),
        (np.eye(4), np.eye(4), "ur10", 1.0, "joints_disagree", False),
        (np.diag([-1.0, -1, 1, 1]), np.eye(4), "ur5", 1.0, "joints_disagree", False),
    ],
)
def test_joint_angles_that_contradict_the_poses_are_not_used(
    one: SyntheticSet,
    tmp_path: Path,
    base: Pose,
    tool: Pose,
    robot: str,
    unit: float,
    code: str,
    with_joints: bool,
) -> None:
    """The wrong arm's model, or a base that a UR's controller turns, put the camera a metre off."""
    write_corners(tmp_path, _plain(one))
    told = base @ one.told @ tool
    q = [to_quaternion(T) for T in told]
    lines = ["x,y,z,qx,qy,qz,qw,q1,q2,q3,q4,q5,q6"]
    lines += [
        ",".join(f"{v:.8f}" for v in (*T[:3, 3], *k, *(j * unit)))
        for T, k, j in zip(told, q, one.joints)
    ]
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    model = load_robot(robot)
    found, odd = with_agreeing_joints(load(tmp_path, BOARD, robot=model), model)
    assert [f.code for f in odd] == [code][: len(code)]
    assert (found.joints is not None) == with_joints
    if found.joints is not None:
        np.testing.assert_allclose(found.joints, one.joints, atol=1e-6)


def test_an_arm_without_joint_angles_is_said(one: SyntheticSet, tmp_path: Path) -> None:
    write_corners(tmp_path, _plain(one))
    rows = [" ".join(f"{v:.8f}" for v in T.ravel()) for T in one.told]
    (tmp_path / "poses.txt").write_text("\n".join(rows) + "\n")
    model = load_robot("ur5")
    _, odd = with_agreeing_joints(load(tmp_path, BOARD, robot=model), model)
    assert [f.code for f in odd] == ["no_joints"]


@pytest.mark.parametrize(("seed", "mount"), [(3001, "base"), (3004, "flange")])
def test_three_views_do_not_tell_where_the_camera_is(seed: int, mount: str, tmp_path: Path) -> None:
    """Readings of their poses that put the camera two metres away fitted, and were written."""
    errors = ArmErrors(1e-4, 1e-3 if mount == "base" else 3e-4)
    one = make_set(load_robot("ur5"), np.random.default_rng(seed), 12, mount, errors)  # type: ignore[arg-type]
    first = plain(replace(one, told=one.told[:3], true=one.true[:3], pixels=one.pixels[:3]))
    write_corners(tmp_path, first)
    rows = [" ".join(f"{v:.8f}" for v in T.ravel()) for T in one.told[:3]]
    (tmp_path / "poses.txt").write_text("\n".join(rows) + "\n")
    found = load(tmp_path, BOARD)
    assert [f.code for f in found.findings if f.severity == "error"] == ["undecided"]
    answer = solve_set(found)
    assert [f.code for f in answer.findings if f.severity == "error"] == ["few_views"]


def test_enough_views_leave_one_reading(one: SyntheticSet, tmp_path: Path) -> None:
    write_corners(tmp_path, _plain(one))
    rows = [" ".join(f"{v:.8f}" for v in T.ravel()) for T in one.told]
    (tmp_path / "poses.txt").write_text("\n".join(rows) + "\n")
    assert [f.code for f in load(tmp_path, BOARD).findings] == []
