"""Every layout of poses is read as what it is, by nothing but the board; the rest is named."""

import json
from pathlib import Path

import numpy as np
import pytest
from arms import ur5
from scipy.spatial.transform import Rotation

from armsight.calibration.boards import Checkerboard
from armsight.calibration.layouts.cells import loose_cells
from armsight.calibration.layouts.folder import list_folder, pose_tables
from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.lens_choice import given_lens
from armsight.calibration.layouts.lens_files import UnusableLens, read_lenses
from armsight.calibration.layouts.pairing import proper_pairings
from armsight.calibration.layouts.series import Series
from armsight.calibration.layouts.table import PoseTable, ordinals
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
    assert said.pose == [0, 1, 2, 3, 4, 5, 6]
    assert said.names == ("x", "y", "z", "qw", "qx", "qy", "qz")
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


def _ros(file: Path, f: float, size: tuple[int, int] = (640, 480), more: str = "") -> Path:
    file.write_text(
        f"image_width: {size[0]}\nimage_height: {size[1]}\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: [{f},0,320,0,{f},240,0,0,1]}}\n{more}"
    )
    return file


def test_each_camera_gets_its_own_lens_or_none(tmp_path: Path) -> None:
    """The first of two lenses was taken for both cameras, without a word."""
    two = [_ros(tmp_path / "cam0.yaml", 500), _ros(tmp_path / "cam1.yaml", 600)]
    for name, wanted in (("cam0", 500), ("cam1", 600), ("1", 600)):
        found = given_lens(two, None, name, (640, 480), 2)
        assert found.lens is not None
        assert found.lens.camera.fx == wanted
        assert not found.findings
    found = given_lens(two, None, "left", (640, 480), 2)
    assert found.lens is None
    assert "no lens is called so (cam0.yaml, cam1.yaml)" in found.findings[0].message
    # A word that is in every lens's file tells none apart.
    both = tmp_path / "left_right.yaml"
    lens = "{intrinsics: [%d,500,320,240], distortion_coeffs: [0,0,0,0], resolution: [640,480]}"
    both.write_text(f"cam0: {lens % 500}\ncam1: {lens % 600}\n")
    assert given_lens([both], both, "right", (640, 480), 2).lens is None
    one = given_lens(two[:1], two[0], "right", (640, 480), 2)
    assert "one lens for 2 cameras" in one.findings[0].message
    alone = given_lens(two, None, "camera", (640, 480), 1)
    assert "2 lenses may be the camera's" in alone.findings[0].message


def test_the_lens_of_the_pictures_size_is_theirs(tmp_path: Path) -> None:
    files = [
        _ros(tmp_path / "depth.yaml", 365, (512, 424)),
        _ros(tmp_path / "rgb.yaml", 1000, (1920, 1080)),
    ]
    found = given_lens(files, None, "camera", (1920, 1080), 1)
    assert found.lens is not None
    assert found.lens.camera.fx == 1000
    assert not found.findings


@pytest.mark.parametrize(
    "more",
    ["camera_model: fisheye\n", "fisheye_model: 1\n", "model: distortion.kannala_brandt4\n",
     "distortion_coefficients: [.nan, 0, 0, 0]\n"],
)  # fmt: skip
def test_a_lens_of_another_model_is_no_pinhole(more: str, tmp_path: Path) -> None:
    file = _ros(tmp_path / "lens.yaml", 500, more=more)
    with pytest.raises(UnusableLens, match=r"lens\.yaml: "):
        read_lenses(file, 640, 480)
    omni = tmp_path / "omni.yaml"
    omni.write_text("camera_model: omni\nintrinsics: [1.5,500,500,320,240]\n")
    with pytest.raises(UnusableLens, match="'omni'"):
        read_lenses(omni, 640, 480)


@pytest.mark.parametrize("width", ["640px", "[640]", ".nan", "-640"])
def test_a_size_that_is_none_ends_nothing(width: str, tmp_path: Path) -> None:
    file = _ros(tmp_path / "lens.yaml", 500)
    file.write_text(file.read_text().replace("image_width: 640", f"image_width: {width}"))
    (lens,) = read_lenses(file, 1280, 960)
    assert (lens.camera.width, lens.sized) == (1280, False)


def test_a_rotation_is_no_lens(tmp_path: Path) -> None:
    file = tmp_path / "tool.yaml"
    file.write_text("matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n")
    assert read_lenses(file, 640, 480) == []


def _comma(cells):
    return [c.replace(".", ",") for c in cells]


def _exported(kind, plain, names):
    """A table as programs of offices and laboratories export it, and its file's bytes."""
    T, q = plain.poses, Rotation.from_matrix(plain.poses[:, :3, :3]).as_quat()
    abc = Rotation.from_matrix(T[:, :3, :3]).as_euler("ZYX", degrees=True)
    mm = [[f"{v:.4f}" for v in 1e3 * t] for t in T[:, :3, 3]]
    wxyz = [[f"{v:.7f}" for v in row[[3, 0, 1, 2]]] for row in q]
    lines = []
    order = sorted(range(len(T)), key=str)  # 1, 10, 11, 2
    if kind == "a name with spaces, semicolons, w first":
        lines = ["Image;X [mm];Y [mm];Z [mm];Qw;Qx;Qy;Qz"]
        lines += [";".join([names[k], *mm[k], *wxyz[k]]) for k in order]
    elif kind == "decimal commas and a name with points":
        lines = ["Bild;X (mm);Y (mm);Z (mm);A (°);B (°);C (°)"]
        angles = [[f"{v:.6f}" for v in row] for row in abc]
        lines += [";".join([names[k], *_comma(mm[k]), *_comma(angles[k])]) for k in order]
    elif kind == "tabs, no header, a name with spaces":
        vector = Rotation.from_matrix(T[:, :3, :3]).as_rotvec(degrees=True)
        for k in order:
            lines.append("\t".join([names[k], *mm[k], *(f"{v:.6f}" for v in vector[k])]))
    elif kind == "blanks, a name with spaces":
        lines = [" ".join([names[k], *mm[k], *wxyz[k]]) for k in order]
    elif kind == "columns of words and empty ones":
        lines = [",image,when,operator,x_mm,y_mm,z_mm,qw,qx,qy,qz,remark"]
        for k in order:
            head = [str(k), f'"{names[k]}"', "2024-05-01 12:00:00", "J. Doe" if k % 2 else ""]
            lines.append(",".join([*head, *mm[k], *wxyz[k], "" if k % 3 else "bright"]))
    elif kind == "a sheet's text with tabs and decimal commas":
        lines = ["image\tX [mm]\tY [mm]\tZ [mm]\tqw\tqx\tqy\tqz"]
        lines += ["\t".join([names[k], *_comma(mm[k]), *_comma(wxyz[k])]) for k in order]
    return ("\r\n".join(lines) + "\r\n").encode("latin-1")


@pytest.mark.parametrize(
    "kind",
    ["a name with spaces, semicolons, w first", "decimal commas and a name with points",
     "tabs, no header, a name with spaces", "blanks, a name with spaces",
     "columns of words and empty ones", "a sheet's text with tabs and decimal commas"],
)  # fmt: skip
def test_an_exported_table_is_read(recorded, kind, tmp_path):
    """A name with a space in it, or a column of words, and there were "no poses in it"."""
    truth, plain = recorded
    names = [f"view {k} of 1.5 m.png" for k in range(1, 15)]
    write_corners(tmp_path, plain, names)
    (tmp_path / "robot poses.csv").write_bytes(_exported(kind, plain, names))
    found = load(tmp_path, BOARD)
    assert found.poses is not None
    rows = found.cameras[0].view
    np.testing.assert_allclose(found.poses[rows], truth.told, atol=2e-5)
    assert [f.code for f in found.findings if f.severity != "note"] == []
    choice = found.cameras[0].choice
    assert choice is not None
    assert choice.best.pairing.words == "by the pictures' names"


@pytest.mark.parametrize(
    ("line", "cells"),
    [
        ("im_1.png [0.1, 0.2, 0.3], [0, 0, 0, 1]", "im_1.png|0.1|0.2|0.3|0|0|0|1"),
        ("tcp 100, 200, 300, 0.5, 0.5, 0.5, 0.5", "tcp|100|200|300|0.5|0.5|0.5|0.5"),
        ("view 1, 0.1, 0.2, 0.3, 0, 0, 0, 1", "view 1|0.1|0.2|0.3|0|0|0|1"),
        ("1,5; 2,5; 3; 4,25", "1.5|2.5|3|4.25"),
        ("1 0 0 0.5;", "1|0|0|0.5"),
        ("1, 0, 0, 0.5; 0, 1, 0, 0.25", "1|0|0|0.5|0|1|0|0.25"),
    ],
)  # fmt: skip
def test_a_line_is_cut_where_its_owner_cut_it(line, cells):
    assert loose_cells(line.replace("[", " ").replace("]", " ")) == cells.split("|")


def _by_names(plain, keys):
    q = Rotation.from_matrix(plain.poses[:, :3, :3]).as_quat()
    rows = [
        f"{key}," + ",".join(f"{v:.8f}" for v in (*T[:3, 3], *r))
        for key, T, r in zip(keys, plain.poses, q)
    ]
    return ["image,x,y,z,qx,qy,qz,qw", *rows]


def test_a_name_with_two_poses_is_left_out_and_said(recorded, tmp_path):
    """The first of the two was taken, without a word."""
    truth, plain = recorded
    write_corners(tmp_path, plain)
    lines = _by_names(plain, [f"im_{k}.png" for k in range(1, 15)])
    again = lines[6].replace("im_6", "im_4")  # the fourth picture was taken anew
    file = tmp_path / "poses.csv"
    file.write_text("\n".join([*lines[:4], again, *lines[4:], lines[1]]) + "\n")
    found = load(tmp_path, BOARD)
    (said,) = [f for f in found.findings if f.severity != "note"]
    assert said.code == "named_twice"
    assert "has im_4.png more than once, with different poses" in said.message
    view = found.cameras[0].view
    assert np.flatnonzero(view < 0).tolist() == [3]  # im_1.png's two lines say the same
    np.testing.assert_allclose(found.poses[view[view >= 0]], np.delete(truth.told, 3, 0), atol=1e-6)


@pytest.mark.parametrize("slash", ["/", "\\"])
def test_a_path_in_a_table_tells_cameras_apart(slash):
    """Pictures of equal names in two folders all got the first folder's poses."""
    files = [Path("set") / side / f"{k}.png" for side in ("left", "right") for k in range(3)]
    keys = tuple(f"D:{slash}set{slash}{f.parent.name}{slash}{f.name}" for f in files)
    table = PoseTable("poses.csv", keys, np.arange(36.0).reshape(6, 6))
    for at, side in enumerate(("left", "right")):
        mine = tuple(f for f in files if f.parent.name == side)
        (pairing,) = proper_pairings(Series(side, mine, (0, 1, 2)), table, np.arange(3))
        assert pairing.row.tolist() == [3 * at, 3 * at + 1, 3 * at + 2]
        assert pairing.twice == ()


@pytest.mark.parametrize("right", [True, False])
def test_quaternions_are_called_by_the_order_of_their_columns(recorded, right, tmp_path):
    """Columns named w x y z were called x y z w, and wrong names of this order fitted nothing."""
    truth, plain = recorded
    write_corners(tmp_path, plain)
    lines = _by_names(plain, [f"im_{k}.png" for k in range(1, 15)])
    if right:
        lines = [",".join(np.array(line.split(","))[[0, 1, 2, 3, 7, 4, 5, 6]]) for line in lines]
    else:
        lines[0] = "image,x,y,z,qw,qx,qy,qz"
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    found = load(tmp_path, BOARD)
    order = "w x y z" if right else "x y z w"
    assert found.cameras[0].choice.best.words().startswith(f"quaternions {order}, metres")
    np.testing.assert_allclose(found.poses[found.cameras[0].view], truth.told, atol=1e-6)
    said = [f.code for f in found.findings if f.severity != "note"]
    assert said == ([] if right else ["quaternion_order"])


@pytest.mark.parametrize("kind", ["a file each", "a list", "by picture"])
def test_poses_with_names_need_not_keep_their_order(recorded, kind, tmp_path):
    """ROS-Industrial's set was refused: "is written in another way: 7 numbers, not 7"."""
    truth, plain = recorded
    write_corners(tmp_path, plain)
    rng = np.random.default_rng(0)
    header, *lines = (line.split(",") for line in _by_names(plain, list(range(1, 15))))
    poses = []
    for _, *numbers in lines:
        named = list(zip(header[1:], map(float, numbers)))
        poses.append({named[i][0]: named[i][1] for i in rng.permutation(len(named))})
    assert len({tuple(pose) for pose in poses}) > 10
    if kind == "a file each":
        (tmp_path / "poses").mkdir()
        for k, pose in enumerate(poses):
            text = "\n".join(f"{name}: {value}" for name, value in pose.items())
            (tmp_path / "poses" / f"{k + 1}.yaml").write_text(text)
    else:
        by_name = {f"im_{k + 1}.png": pose for k, pose in enumerate(poses)}
        told = poses if kind == "a list" else by_name
        (tmp_path / "poses.json").write_text(json.dumps(told))
    found = load(tmp_path, BOARD)
    np.testing.assert_allclose(found.poses[found.cameras[0].view], truth.told, atol=1e-6)
    assert [f.code for f in found.findings if f.severity != "note"] == []


@pytest.mark.parametrize("name", ["poses.json", "poses.yaml"])
def test_a_document_has_a_name_once(recorded, name, tmp_path):
    """The last of two poses of one name was taken, without a word."""
    _, plain = recorded
    write_corners(tmp_path, plain)
    rows = [(f"im_{k + 1}.png", T.ravel().tolist()) for k, T in enumerate(plain.poses)]
    file = tmp_path / name

    def write(pairs):
        lines = ",\n".join(f'"{key}": {value}' for key, value in pairs)
        file.write_text("{" + lines + "}")

    write([*rows, rows[2]])  # the same again does no harm
    assert load(tmp_path, BOARD).findings == ()
    write([*rows, (rows[2][0], rows[3][1])])
    with pytest.raises(CalibrationError, match=r'poses\..*has "im_3.png" more than once'):
        load(tmp_path, BOARD)
