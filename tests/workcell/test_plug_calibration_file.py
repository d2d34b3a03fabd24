"""What ``calibrate --plug`` leaves in the calibration file, who believes it and who refuses it."""

import numpy as np
import pytest

from armsight.charging.ports.table import PORTS
from armsight.commands.calibration import lines
from armsight.errors import WorkcellError
from armsight.geometry.pose import exp, inverse
from armsight.simulation.units import draw_camera
from armsight.workcell import load_workcell, robot_in, world_spec
from armsight.workcell.calibration_file.reading import (
    BY_PLUG,
    calibrated_robot,
    calibration_of,
    mount_pose,
)
from armsight.workcell.calibration_file.store import store
from armsight.workcell.calibration_file.writing import arm_entry, plug_entry, stereo_entry
from armsight.workcell.packaged import load

C = np.diag([1e-8] * 3 + [1e-7] * 3)
TWIST = np.array([0.004, -0.003, 0.002, 0.01, -0.02, 0.01])


@pytest.fixture
def cell(tmp_path):
    file = tmp_path / "station.toml"
    file.write_text(load("ur10_charging").text)
    return load_workcell(file)


def keep(cell, source=BY_PLUG):
    """As the command does."""
    section, tool = cell.stereo[0], robot_in(cell).tool
    pair = stereo_entry(
        cell, section, mount_pose(cell, section) @ exp(TWIST), C,
        model="converging_pair", source=BY_PLUG,
    )  # fmt: skip
    plug = plug_entry(
        cell.plug, tool.T_flange_tcp @ exp(TWIST), C, tool.T_flange_tcp,
        source=BY_PLUG, tip_error=1e-4,
    )  # fmt: skip
    arm = arm_entry(np.full(6, 1e-3), np.zeros((6, 3)), source=source)
    return store(cell, (), arm, stereo=(pair,), plug=plug)


def test_pair_plug_and_arm_are_believed_and_the_truth_stays(cell):
    before = world_spec(cell)
    keep(cell)
    calibration = calibration_of(cell)
    after = world_spec(cell, calibration)
    pair = after.stereo[0].info
    step = inverse(before.stereo[0].info.T_mount_camera) @ pair.T_mount_camera
    np.testing.assert_allclose(step, exp(TWIST), atol=1e-9)
    np.testing.assert_allclose(pair.covariance, C)
    assert after.stereo[1].info.covariance is None
    for a, b in zip(before.stereo, after.stereo):
        truth = draw_camera(a, (3, 40)), draw_camera(b, (3, 40))
        np.testing.assert_array_equal(truth[0].T_mount_camera, truth[1].T_mount_camera)
    nominal = robot_in(cell)
    robot = calibrated_robot(nominal, calibration)
    tip = inverse(nominal.tool.T_flange_tcp) @ robot.tool.T_flange_tcp
    np.testing.assert_allclose(tip, exp(TWIST), atol=1e-9)
    assert len(robot.spheres.radius) == len(nominal.spheres.radius)
    assert not np.allclose(robot.T_link_joint, nominal.T_link_joint)


def test_they_are_shown_with_how_sure_they_are(cell):
    keep(cell)
    told = lines(cell, calibration_of(cell))
    pair = next(line for line in told if line.startswith("pair post"))
    plug = next(line for line in told if line.startswith("plug"))
    assert "0.10 mm 0.018°" in pair
    assert plug.split()[1] == "flange"
    assert float(plug.split()[4]) == pytest.approx(202.0, abs=0.1)


def test_anew_it_starts_without_what_the_plug_has_told(cell):
    keep(cell)
    anew = calibration_of(cell, by_plug=False)
    assert (anew.plug, anew.stereo, anew.arm) == (None, (), None)
    keep(cell, source="armsight calibrate, live, 30 views")
    assert calibration_of(cell, by_plug=False).arm is not None  # the cameras rest on it


def test_another_plug_is_refused_and_can_be_calibrated(cell):
    """The plug was exchanged: the cell says so, and the command that mends it still opens it."""
    keep(cell)
    other = cell.model_copy(update={"plug": cell.plug.model_copy(update={"kind": "type1_plug"})})
    with pytest.raises(
        WorkcellError, match=r"plug.kind.*is of a type2_plug.*the plug was exchanged.*calibrate"
    ):
        calibration_of(other)
    assert calibration_of(other, by_plug=False) is not None


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ('name = "post"', 'name = "pole"', r'stereo "pole".*no such pair'),
        ('model = "converging_pair"', 'model = "flange_pair"', "was a flange_pair when"),
        ('mount = "base"', 'mount = "flange"', "was calibrated in flange"),
        ("tip_error = 0.0001", "tip_error = -1.0", "tip_error"),
        ("position = [0.0, 0.0, 0.2]", "position = [0.0, 0.0, 0.3]", "older than the cell's tool"),
    ],
)  # fmt: skip
def test_what_is_not_this_cells_is_refused_in_a_line(cell, right, wrong, says):
    file = keep(cell)
    text = file.read_text()
    assert right in text
    file.write_text(text.replace(right, wrong, 1))
    with pytest.raises(WorkcellError, match=says):
        calibration_of(cell)


def test_the_drawn_front_stands_before_what_the_tool_shows(cell):
    """The tool's mesh ends where the plug's face with its contacts begins: none hides the other."""
    plug = world_spec(cell).plug
    front = min(look.vertices[:, 2].min() for look in plug.looks)
    assert -0.002 < plug.drawn - front < 0.0
    assert front < -PORTS["type2_plug"].depth
