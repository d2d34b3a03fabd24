"""Lenses and transforms of others into a cell's calibration file, and out of it again."""

import re

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from armsight.calibration.export import camera_info_yaml, opencv_yaml
from armsight.cli import run
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, make_pose
from armsight.tasks.calibration_exchange import brought, exported, read_transforms
from armsight.workcell import camera_info_of, load_workcell
from armsight.workcell.calibration_file.reading import calibration_of, mount_pose

CELL = """
[cell]
name = "lab"
[robot]
model = "ur5"
position = [0.1, 0.0, 0.8]
[[camera]]
name = "left"
model = "kinect_v2"
position = [1.3, 0.8, 1.6]
look_at = [0.4, 0.0, 1.2]
[[camera]]
name = "wrist"
model = "f200"
mounted_on = "flange"
position = [0.0, 0.05, 0.03]
rpy_deg = [0, 0, 0]
[simulation]
color_scale = 1.0
"""


@pytest.fixture
def cell(tmp_path):
    (tmp_path / "lab.toml").write_text(CELL)
    return load_workcell(tmp_path / "lab.toml")


def transform(T, **rest):
    """As ROS writes it, by scipy's quaternion."""
    q = Rotation.from_matrix(T[:3, :3]).as_quat()
    return {
        **rest,
        "translation": dict(zip("xyz", map(float, T[:3, 3]))),
        "rotation": dict(zip("xyzw", map(float, q))),
    }


def test_what_is_imported_is_exported_and_comes_back(cell, tmp_path):
    """Pose, both lenses and the colour lens's place, into the file and out of it."""
    info = camera_info_of(cell, cell.camera[0])
    T = mount_pose(cell, cell.camera[0]) @ exp(np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.03]))
    T_color = make_pose(None, [0.051, 0.001, -0.002])
    depth = PinholeCamera(512, 424, 366.1, 365.2, 257.3, 205.1, (0.09, -0.2, 1e-3, -1e-3, 0.05))
    color = PinholeCamera(1920, 1080, 1061.0, 1062.0, 958.0, 551.0, (0.05, -0.1, 0.0, 0.0, 0.0))
    (tmp_path / "left_depth.yaml").write_text(camera_info_yaml("left_depth", depth))
    (tmp_path / "rgb.yaml").write_text(opencv_yaml(color))
    tf = [
        transform(T, parent="base", child="left_depth_optical_frame"),
        transform(T_color, parent="left_depth_optical_frame", child="left_color_optical_frame"),
        transform(np.eye(4), parent="base", child="another"),
    ]
    (tmp_path / "tf.yaml").write_text(yaml.safe_dump(tf))
    files = [str(tmp_path / n) for n in ("left_depth.yaml", "rgb.yaml", "tf.yaml")]
    words = ["calibration", "import", str(cell.file), *files, "--camera", "left", "--sigma-mm", "2"]
    assert run(words) == 0
    found = calibration_of(cell)
    left = found.of("left")
    np.testing.assert_allclose(left.pose, T, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diagonal(left.C))[:3], 0.002)
    assert left.depth_lens.lens == depth
    assert left.color_lens.lens == color
    np.testing.assert_allclose(left.color_lens.pose, T_color, atol=1e-9)
    assert found.of("wrist") is None
    for name, text in exported(found).items():
        (tmp_path / name).write_text(text)
    names = ("left_color.opencv.yaml", "left_depth.camera_info.yaml", "tf.yaml")
    again = brought([tmp_path / name for name in names], info, cell.robot.T_world_base)
    assert (again.depth, again.color) == (depth, color)
    np.testing.assert_allclose(again.T_mount_depth, T, atol=1e-9)
    np.testing.assert_allclose(again.T_depth_color, T_color, atol=1e-9)


def test_a_lens_alone_keeps_the_rest(cell, tmp_path, capsys):
    T = mount_pose(cell, cell.camera[0])
    (tmp_path / "tf.yaml").write_text(yaml.safe_dump(transform(T)))
    words = ["calibration", "import", str(cell.file), str(tmp_path / "tf.yaml"), "--camera", "left"]
    assert run([*words, "--sigma-mm", "1.5", "--sigma-deg", "0.1"]) == 0
    depth = PinholeCamera(512, 424, 366.1, 365.2, 257.3, 205.1)
    (tmp_path / "ir.yaml").write_text(camera_info_yaml("left_ir", depth.scaled(2)))
    words[3] = str(tmp_path / "ir.yaml")
    assert run(words) == 0
    left = calibration_of(cell).of("left")
    assert left.depth_lens.lens.fx == pytest.approx(366.1)
    assert left.depth_lens.width == 512
    np.testing.assert_allclose(left.pose, T, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diagonal(left.C))[:3], 0.0015)
    capsys.readouterr()
    assert run(["calibration", "show", str(cell.file)]) == 0
    said = capsys.readouterr().out
    assert re.search(r"left +base .* 1\.50 mm 0\.100°", said)
    assert re.search(r"wrist +never calibrated", said)


def test_every_layout_of_a_transform(tmp_path):
    T = make_pose(Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix(), [0.5, -0.3, 1.2])
    q = Rotation.from_matrix(T[:3, :3]).as_quat()
    flat = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(float, (*T[:3, 3], *q))))
    header = {"frame_id": "/base"}
    stamped = {"header": header, "child_frame_id": "cam", "transform": transform(T)}
    for document in (
        transform(T),
        {"parameters": {"eye_on_hand": False}, "transformation": flat},
        {"transforms": [stamped]},
        [transform(T, parent="base", child="cam")],
    ):
        (tmp_path / "tf.yaml").write_text(yaml.safe_dump(document))
        [placed] = read_transforms(tmp_path / "tf.yaml")
        np.testing.assert_allclose(placed.T, T, atol=1e-12)
        if "parameters" not in document and "rotation" not in document:
            assert (placed.parent, placed.child) == ("base", "cam")


ZERO = "translation: [0, 0, 1]\nrotation: [0, 0, 0, 1]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("translation: {x: 1, y: 2, z: 3}\nrotation: {x: 1, y: 1, z: 0, w: 0}", "no rotation"),
        ("translation: [1300, 2, 3]\nrotation: [0, 0, 0, 1]", "expected metres"),
        (f"parent: base\nchild: right\n{ZERO}", "no transform of left_depth_optical_frame"),
        (f"parent: table\nchild: left\n{ZERO}", "in table, expected base"),
        ("[: :", "cannot be read as YAML"),
        ("a: 1", "neither a lens nor a transform"),
    ],
)
def test_what_says_nothing_of_the_camera_is_refused_in_a_line(cell, tmp_path, text, words):
    (tmp_path / "x.yaml").write_text(text)
    info = camera_info_of(cell, cell.camera[0])
    with pytest.raises(CalibrationError, match=words) as error:
        brought([tmp_path / "x.yaml"], info, cell.robot.T_world_base)
    assert "\n" not in str(error.value)


def test_a_lens_of_another_shape_of_picture_is_refused(cell, tmp_path):
    lens = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
    (tmp_path / "x.yaml").write_text(camera_info_yaml("c", lens))
    info = camera_info_of(cell, cell.camera[0])
    with pytest.raises(CalibrationError, match="picture of 640x480 px, and the depth lens"):
        brought([tmp_path / "x.yaml"], info, cell.robot.T_world_base)


def test_poses_in_world_are_brought_to_the_base(cell, tmp_path):
    T = make_pose(None, [1.3, 0.8, 1.6])
    (tmp_path / "x.yaml").write_text(yaml.safe_dump(transform(T, parent="world", child="left")))
    info = camera_info_of(cell, cell.camera[0])
    found = brought([tmp_path / "x.yaml"], info, cell.robot.T_world_base)
    np.testing.assert_allclose(found.T_mount_depth[:3, 3], [1.2, 0.8, 0.8])


def test_nothing_to_export(cell, capsys):
    assert run(["calibration", "export", str(cell.file)]) == 1
    assert "never calibrated" in capsys.readouterr().err
