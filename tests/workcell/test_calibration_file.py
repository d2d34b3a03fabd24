"""The calibration file: what is written is read, what is not this cell's is refused in a line."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.calibration.arm import flange_poses
from armsight.calibration.robot_errors import RobotErrors
from armsight.devices.depth_model import DepthModel
from armsight.errors import WorkcellError
from armsight.geometry.pose import exp, inverse, transform
from armsight.robots.kinematics import flange_pose
from armsight.robots.tools import load_tool
from armsight.simulation.scoring import camera_error
from armsight.simulation.units import draw_camera
from armsight.workcell import camera_info_of, load_workcell, robot_in, world_spec
from armsight.workcell.calibration_file.reading import (
    calibrated_info,
    calibrated_robot,
    calibration_of,
    mount_pose,
    parse_calibration,
)
from armsight.workcell.calibration_file.writing import arm_entry, board_entry, camera_entry, updated

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
calibration_error_mm = 20
calibration_error_deg = 1.0
lens_error = 1.0
depth_error = 1.0
arm_kinematic_error = 1.0
"""
WHEN = datetime(2026, 11, 22, 5, 0, tzinfo=UTC)
MODEL = DepthModel(
    0.016, 0.003, np.array([0.8, 0.95]), np.array([1e-3, -1e-3]), np.array([0, 0, 2e-3]),
    1.1, (0.7, 1.5), 5e-4, True,
)  # fmt: skip


@pytest.fixture
def cell(tmp_path):
    (tmp_path / "lab.toml").write_text(CELL)
    return load_workcell(tmp_path / "lab.toml")


def entry(cell, index=0, twist=(0, 0, 0, 0, 0, 0), model=MODEL, **changes):
    section = cell.camera[index]
    info = camera_info_of(cell, section)
    values = {
        "T_mount_camera": info.T_mount_camera @ exp(np.array(twist, float)),
        "covariance": np.diag([1e-6] * 3 + [1e-7] * 3),
        "depth_lens": replace(info.depth, fx=info.depth.fx * 1.01),
        "color_lens": info.color,
        "T_depth_color": info.T_depth_color,
        "depth_model": model,
        **changes,
    }
    return camera_entry(cell, section, **values, source="test", target_error=1e-3, now=WHEN)


def write(cell, *entries, arm=None, text=""):
    file = cell.calibration_file
    file.write_text(updated(text, cell, entries, arm))
    return file


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(-0.1, 0.1), min_size=6, max_size=6),
    st.lists(st.floats(-3e-3, 3e-3), min_size=36, max_size=36),
    st.floats(-0.05, 0.05),
)
def test_what_is_written_is_read(tmp_path_factory, twist, spread, offset):
    folder = tmp_path_factory.mktemp("cell")
    (folder / "lab.toml").write_text(CELL)
    cell = load_workcell(folder / "lab.toml")
    A = np.reshape(spread, (6, 6))
    C = A @ A.T + 1e-9 * np.eye(6)
    model = replace(MODEL, offset=offset)
    for index in (0, 1):
        found = entry(cell, index, twist, model, covariance=C)
        write(cell, found)
        calibration = calibration_of(cell)
        believed = camera_info_of(cell, cell.camera[index], calibration)
        declared = camera_info_of(cell, cell.camera[index])
        step = inverse(declared.T_mount_camera) @ believed.T_mount_camera
        np.testing.assert_allclose(step, exp(np.array(twist)), atol=1e-9)
        np.testing.assert_allclose(believed.covariance, C, rtol=1e-9, atol=1e-18)
        assert believed.depth.fx == pytest.approx(1.01 * declared.depth.fx)
        z = np.linspace(0.6, 1.8, 7)
        np.testing.assert_allclose(believed.depth_model.along(z), model.along(z), atol=1e-9)
        assert believed.calibrated
        assert not declared.calibrated


def test_other_entries_and_comments_stay(cell):
    file = write(cell, entry(cell), entry(cell, 1))
    text = file.read_text().replace('source = "test"', 'source = "test" # by Anna', 1)
    text = text.replace("[cell]", "# our lab\n[cell]")
    again = updated(text, cell, [entry(cell, 0, (0.01, 0, 0, 0, 0, 0))])
    assert "# by Anna" in again
    assert "# our lab" in again
    new, old = parse_calibration(again), parse_calibration(text)
    assert new.of("wrist") == old.of("wrist")
    assert new.of("left").position != old.of("left").position


def test_a_camera_that_the_cell_no_longer_has_goes(cell):
    text = updated("", cell, [entry(cell), entry(cell, 1)])
    smaller = cell.model_copy(update={"camera": cell.camera[:1]})
    assert [c.name for c in parse_calibration(updated(text, smaller, [])).camera] == ["left"]


def test_without_a_file_the_declaration_is_believed(cell):
    assert calibration_of(cell) is None


WRONG = [
    ('name = "lab"', 'name = "other"', r'cell.name: is of cell "other", and this is "lab"'),
    ('robot = "ur5"', 'robot = "ur10"', r"cell.robot: was made with a ur10"),
    ('name = "left"', 'name = "lift"', r'camera "lift": the cell has no such camera; did you me'),
    ('model = "kinect_v2"', 'model = "kinect_v1"', r"model: was a kinect_v1 when it was calib"),
    ('mount = "base"', 'mount = "flange"', r"mount: was calibrated in flange"),
    ("width = 512", "width = 511", r"511x424 px, and the camera has 512x424"),
    ("width = 512", "width = 51200", r"width"),
    ("fx = 369", "fx = -369", r"fx: found -369"),
    ("fx = 369", "fx = 9", r"fx is 9\.\d+ px for a picture of 512 px"),
    ("offset = 0.016", "offset = 16.0", r"no depth camera is that wrong"),
    ("knots = [0.8, 0.95]", "knots = [0.95, 0.8]", r"the knots do not rise"),
    ("knots = [0.8, 0.95]", "knots = [0.8]", r"1 knots and 2 values"),
    ("rms = 0.0005", 'rms = 0.0005\nunit = "mm"', r"unit: unknown key"),
    ("[1e-06, 0.0,", "[-1e-06, 0.0,", r"covariance is not positive definite"),
    ("[1e-06, 0.0,", "[1e-06, 1e-06,", r"covariance is not symmetric"),
    ("[1e-06, 0.0,", "[nan, 0.0,", r"finite number"),
    ("calibrated = 2026-11-22T05:00:00Z", "", r"calibrated: missing"),
]


@pytest.mark.parametrize(("right", "wrong", "says"), WRONG)
def test_what_is_not_this_cells_is_refused_in_a_line(cell, right, wrong, says):
    file = write(cell, entry(cell))
    text = file.read_text()
    assert right in text
    file.write_text(text.replace(right, wrong, 1))
    with pytest.raises(WorkcellError, match=says) as error:
        camera_info_of(cell, cell.camera[0], calibration_of(cell))
    assert len(str(error.value).splitlines()) == 1


def test_no_rotation_is_refused(cell):
    text = write(cell, entry(cell)).read_text()
    line = next(row for row in text.splitlines() if row.startswith("quaternion_xyzw"))
    with pytest.raises(WorkcellError, match=r"length 1\.\d+, expected 1: it is no rotation"):
        parse_calibration(text.replace(line, "quaternion_xyzw = [1.0, 0.2, 0.0, 0.0]"))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.97])
def test_half_written_files_are_refused(cell, share):
    text = write(cell, entry(cell), entry(cell, 1)).read_text()
    with pytest.raises(WorkcellError):
        parse_calibration(text[: int(share * len(text))])


def test_a_broken_file_is_not_overwritten(cell):
    with pytest.raises(WorkcellError, match="half written"):
        updated("[cell\nname", cell, [entry(cell)])


def test_a_camera_declared_elsewhere_since(cell, tmp_path):
    write(cell, entry(cell))
    (tmp_path / "lab.toml").write_text(CELL.replace("[1.3, 0.8, 1.6]", "[1.3, 0.7, 1.6]"))
    moved = load_workcell(tmp_path / "lab.toml")
    with pytest.raises(WorkcellError, match=r"older than the cell's file.*since 2026-11-22 05:00"):
        calibration_of(moved)
    (tmp_path / "lab.toml").write_text("# a comment more\n" + CELL)
    assert calibration_of(load_workcell(tmp_path / "lab.toml")) is not None


def test_another_cameras_pose(cell):
    write(cell, entry(cell, 0, (0.8, 0, 0, 0, 0, 0)))
    with pytest.raises(WorkcellError, match=r"stands 0\.80 m and 0 deg from where the cell's file"):
        calibration_of(cell)


def test_a_file_that_is_named_must_be_there(tmp_path):
    text = CELL.replace('name = "lab"', 'name = "lab"\ncalibration = "monday.toml"', 1)
    (tmp_path / "lab.toml").write_text(text)
    cell = load_workcell(tmp_path / "lab.toml")
    with pytest.raises(WorkcellError, match=r"monday\.toml, which is not there"):
        calibration_of(cell)
    write(cell, entry(cell))
    assert (tmp_path / "monday.toml").is_file()
    assert calibration_of(cell).of("left") is not None


def test_arm_errors_reach_the_kinematics(cell):
    """Against the calibration's own kinematics of an arm with errors."""
    robot = robot_in(cell)
    errors, rng = RobotErrors(robot), np.random.default_rng(0)
    theta = rng.normal(0, 1, errors.size) * errors.sigma
    offset, shift = np.zeros(6), np.zeros((6, 3))
    offset[list(errors.offset_joints)] = theta[: len(errors.offset_joints)]
    for (i, k), d in zip(errors.length_axes, theta[len(errors.offset_joints) :]):
        shift[i, k] = d
    theta[len(errors.offset_joints) + len(errors.length_axes) :] = 0.0  # no sag
    write(cell, entry(cell), arm=arm_entry(offset, shift, source="test", now=WHEN))
    found = calibrated_robot(robot, calibration_of(cell))
    q = rng.uniform(-2, 2, (5, 6))
    expected, _ = errors.flange_poses(q, theta)
    for row, T in zip(q, expected):
        np.testing.assert_allclose(flange_pose(found, row), T, atol=1e-9)
    assert np.abs(expected - flange_poses(robot, q)).max() > 1e-4


def test_the_board_on_the_arm_hangs_where_it_was_found(tmp_path):
    """The tool that is the board moves with it; another tool and a stale entry do not."""
    text = CELL.replace('model = "ur5"', 'model = "ur5"\ntool = "calibration_board"') + "[board]\n"
    (tmp_path / "lab.toml").write_text(text)
    cell = load_workcell(tmp_path / "lab.toml")
    robot = robot_in(cell)
    off = exp(np.array([0.01, 0.005, -0.004, 0.03, 0.02, -0.05]))
    found = board_entry(cell.board, off @ cell.board.pose, source="test", now=WHEN)
    text = updated("", cell, [entry(cell)], board=found)
    cell.calibration_file.write_text(updated(text, cell, [entry(cell)]))  # it stays
    carried = calibrated_robot(robot, calibration_of(cell))
    np.testing.assert_allclose(
        carried.tool.spheres.center, transform(off, robot.tool.spheres.center), atol=1e-9
    )
    held = robot.without_tool().with_tool(load_tool("gripper"))
    assert calibrated_robot(held, calibration_of(cell)).tool is held.tool
    (tmp_path / "lab.toml").write_text(
        (tmp_path / "lab.toml").read_text() + "position = [0, 0, 0.07]"
    )
    with pytest.raises(WorkcellError, match=r"the board has been declared elsewhere since"):
        calibration_of(load_workcell(tmp_path / "lab.toml"))


def test_the_truth_is_drawn_without_the_calibration(cell):
    """One draw for every command: what is believed changes, what is true does not."""
    before = world_spec(cell)
    write(cell, entry(cell, 0, (0.01, 0.02, 0.0, 0.01, 0.0, 0.0)))
    after = world_spec(cell, calibration_of(cell))
    assert after.cameras[0].info.depth.fx != before.cameras[0].info.depth.fx
    for a, b in zip(before.cameras, after.cameras):
        one, two = draw_camera(a, (3, 20)), draw_camera(b, (3, 20))
        assert one.depth == two.depth
        assert one.color == two.color
        assert one.errors == two.errors
        np.testing.assert_array_equal(one.T_mount_camera, two.T_mount_camera)
        np.testing.assert_array_equal(one.T_depth_color, two.T_depth_color)
    other = draw_camera(before.cameras[0], (4, 20))
    assert other.depth != draw_camera(before.cameras[0], (3, 20)).depth


def test_a_unit_differs_from_its_declaration_by_the_stated_sizes(cell):
    spec = world_spec(cell).cameras[0]
    units = [draw_camera(spec, (seed, 20)) for seed in range(200)]
    focal = np.array([u.depth.fx / spec.info.depth.fx - 1 for u in units])
    assert np.std(focal) == pytest.approx(0.0101, rel=0.2)
    away = [inverse(spec.T_mount_camera_declared) @ u.T_mount_camera for u in units]
    assert np.std([T[:3, 3] for T in away]) == pytest.approx(0.02, rel=0.1)


def test_who_believes_the_truth_is_not_wrong(cell):
    """The score: nothing for the truth itself, and the known size for a known error."""
    spec = world_spec(cell).cameras[0]
    unit = draw_camera(replace(spec, errors=False), (0, 20))
    T = inverse(cell.robot.T_world_base) @ unit.T_mount_camera
    true = replace(spec.info, depth=unit.depth, T_mount_camera=T)
    assert camera_error(true, T, 1.0, unit, T).pose == pytest.approx(0.0, abs=1e-12)
    off = T @ exp(np.array([0.003, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert camera_error(true, off, 1.0, unit, T).pose == pytest.approx(0.003, rel=1e-6)


def test_depth_models_are_undone_by_who_reads_them(cell):
    info = calibrated_info(camera_info_of(cell, cell.camera[0]), entry(cell))
    model, lens = info.depth_model, info.depth
    rng = np.random.default_rng(1)
    true = rng.uniform(0.7, 1.5, (lens.height, lens.width))
    v, u = np.mgrid[0 : lens.height, 0 : lens.width].astype(float)
    error = model.error(true.ravel(), np.stack([u.ravel(), v.ravel()], 1), lens)
    measured = (true + error.reshape(true.shape)).astype(np.float32)
    measured[3, 4] = np.nan
    corrected = model.corrected(measured, lens)
    assert np.isnan(corrected[3, 4])
    corrected[3, 4] = true[3, 4]
    assert np.abs(corrected - true).max() < 1e-5
    assert np.abs(measured[5:] - true[5:]).max() > 0.01


def test_the_declared_mount_is_what_the_entry_keeps(cell):
    found = entry(cell)
    np.testing.assert_allclose(found.declared.pose, mount_pose(cell, cell.camera[0]), atol=1e-9)
