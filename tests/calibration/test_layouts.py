"""Every layout of poses is read as what it is, by nothing but the board; the rest is named."""

import numpy as np
import pytest
from arms import ur5

from armsight.calibration.boards import Checkerboard
from armsight.calibration.layouts.folder import list_folder, pose_tables
from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.lens_files import read_lenses
from armsight.calibration.layouts.table import ordinals
from armsight.calibration.recorded_set import load
from armsight.calibration.synthetic_set import ArmErrors, make_set
from armsight.errors import CalibrationError
from armsight.experiments.calibration_layouts import LAYOUTS, PlainSet, write_corners, write_layout

BOARD = Checkerboard(10, 7, 0.025, hollow=False)


@pytest.fixture(scope="module", params=["base", "flange"])
def recorded(request):
    one = make_set(ur5(), np.random.default_rng(4), 14, request.param, ArmErrors(3e-4, 3e-4))
    every = np.arange(len(one.points))
    return one, PlainSet(one.told, tuple((every, p) for p in one.pixels), (1280, 960))


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_is_read_as_what_it_is(recorded, name, tmp_path):
    truth, plain = recorded
    write_layout(tmp_path, name, plain)
    found = load(tmp_path, BOARD)
    assert found.poses is not None
    assert found.cameras[0].mount == truth.mount
    rows = found.cameras[0].view
    np.testing.assert_allclose(found.poses[rows], truth.told, atol=2e-5)
    assert [f.code for f in found.findings if f.severity != "note"] == []
    assert any(r.what == "poses" and r.otherwise for r in found.read_as)


def test_missing_pictures_are_paired_by_number(recorded, tmp_path):
    _, plain = recorded
    write_layout(tmp_path, "3x4 rows (KITTI)", plain)
    kept = [k for k in range(14) if k not in (3, 7)]
    some = PlainSet(plain.poses, tuple(plain.corners[k] for k in kept), plain.size)
    write_corners(tmp_path, some, [f"im_{k + 1}.png" for k in kept])
    found = load(tmp_path, BOARD)
    assert found.cameras[0].view.tolist() == kept


def test_half_text_is_named_with_its_line(recorded, tmp_path):
    write_layout(tmp_path, "quaternion x y z w without header", recorded[1])
    file = tmp_path / "tcp.txt"
    lines = file.read_text().splitlines()
    lines[4] = "the operator went for lunch here"
    file.write_text("\n".join(lines))
    tables, unread = pose_tables(list_folder(tmp_path), 14)
    assert tables == []
    reason = next(u.reason for u in unread if u.file == file)
    assert "tcp.txt, line 5: cannot be read as a pose like the 13 others" in reason
    file.rename(tmp_path / "poses_tcp.txt")
    with pytest.raises(CalibrationError, match=r"poses_tcp.txt, line 5"):
        load(tmp_path, BOARD)


def test_hand_without_poses_is_an_error_and_names_what_was_not_read(recorded, tmp_path):
    write_corners(tmp_path, recorded[1])
    (tmp_path / "readme.txt").write_text("nothing here\n")
    with pytest.raises(CalibrationError, match=r"readme\.txt"):
        load(tmp_path, BOARD, mount="flange")
    assert load(tmp_path, BOARD).poses is None


def test_an_empty_folder_is_named(tmp_path):
    with pytest.raises(CalibrationError, match="no pictures"):
        load(tmp_path, BOARD)
    with pytest.raises(CalibrationError, match="no such folder"):
        load(tmp_path / "there", BOARD)


def test_names_of_columns():
    said = Columns(["file name", "X [mm]", "Y [mm]", "Z [mm]", "A (deg)", "B (deg)", "C (deg)"])
    assert said.names == ("x", "y", "z", "rx", "ry", "rz")
    assert (said.length, said.rotation) == (1e-3, "ZYX")
    assert said.angle == pytest.approx(np.pi / 180)
    said = Columns(["pose.position.x", "pose.position.y", "pose.position.z",
                    *(f"pose.orientation.{a}" for a in "wxyz")])  # fmt: skip
    assert said.pose == [0, 1, 2, 4, 5, 6, 3]
    said = Columns(["image", "q1", "q2", "q3", "q4", "q5", "q6", "x", "y", "z", "rx", "ry", "rz"])
    assert said.joints == [1, 2, 3, 4, 5, 6]
    assert said.pose == [7, 8, 9, 10, 11, 12]
    assert not Columns(["a", "b", "c"]).pose


def test_the_number_that_tells_names_apart():
    assert ordinals(["cam2_007_1080.png", "cam2_008_1080.png"]) == [7, 8]
    assert ordinals(["a.png", "b1.png"]) == [None, 1]


def test_lenses_of_others(tmp_path):
    kalibr = tmp_path / "camchain.yaml"
    kalibr.write_text(
        "cam0:\n  camera_model: pinhole\n  intrinsics: [461.6, 460.3, 362.7, 248.1]\n"
        "  distortion_model: radtan\n  distortion_coeffs: [-0.28, 0.07, 0.0001, 0.00002]\n"
        "  resolution: [752, 480]\n"
    )
    (lens,) = read_lenses(kalibr, 1, 1)
    assert (lens.camera.fx, lens.camera.width, lens.name) == (461.6, 752, "cam0")
    fish = tmp_path / "fish.yaml"
    fish.write_text(kalibr.read_text().replace("radtan", "equidistant"))
    with pytest.raises(CalibrationError, match="equidistant"):
        read_lenses(fish, 1, 1)


def test_poses_of_the_pictures_with_the_board_alone(recorded, tmp_path):
    truth, plain = recorded
    lost = {2, 7, 8}
    empty = (np.zeros(0, int), np.zeros((0, 2)))
    corners = tuple(empty if k in lost else c for k, c in enumerate(plain.corners))
    write_corners(tmp_path, PlainSet(plain.poses, corners, plain.size))
    # Pictures without a board have a line, too, so that they are known.
    text = (tmp_path / "corners.csv").read_text()
    text += "".join(f"im_{k + 1}.png,0,nan,nan\n" for k in sorted(lost))
    (tmp_path / "corners.csv").write_text(text)
    kept = [k for k in range(14) if k not in lost]
    rows = "\n".join(" ".join(f"{v:.8f}" for v in T.ravel()) for T in truth.told[kept])
    (tmp_path / "poses.txt").write_text(rows + "\n")
    found = load(tmp_path, BOARD)
    view = found.cameras[0].view
    assert [k for k in range(14) if view[k] < 0] == sorted(lost)
    assert found.poses is not None
    np.testing.assert_allclose(found.poses[view[kept]], truth.told[kept], atol=1e-6)


def test_counts_that_no_name_ties_are_said(recorded, tmp_path):
    truth, plain = recorded
    write_corners(tmp_path, plain)
    rng = np.random.default_rng(3)
    some = truth.told[np.sort(rng.choice(14, 9, replace=False))[::-1]]
    rows = "\n".join(" ".join(f"{v:.8f}" for v in T.ravel()) for T in some)
    (tmp_path / "poses.txt").write_text(rows + "\n")
    (said,) = [f for f in load(tmp_path, BOARD).findings if f.code == "poses_do_not_match"]
    assert "14 pictures and 9 poses, and no name that ties them" in said.message


@pytest.mark.parametrize("name", ["poses.xlsx", "poses.pkl", "demo.h5"])
def test_files_of_other_programs_are_named(recorded, name, tmp_path):
    _, plain = recorded
    write_corners(tmp_path, plain)
    (tmp_path / name).write_bytes(b"PK\x03\x04" + bytes(50))
    _, unread = pose_tables(list_folder(tmp_path), 14)
    assert [u.file.name for u in unread if "save" in u.reason] == [name]
