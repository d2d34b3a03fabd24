"""Cells with drivers: found by name or module, opened and closed as one, mixed with simulation."""

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "devices"))
import plugged_doubles
from plugged_doubles import LOG

from armsight.devices.data import GripperState, Wrench
from armsight.devices.driven_arm import DrivenArm
from armsight.devices.driven_cameras import DrivenCamera
from armsight.errors import DeviceError, UsageError, WorkcellError
from armsight.geometry.pose import inverse
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.workcell import drivers, open_cell, parse_workcell

HERE = "plugged_doubles"
REAL = f"""
[cell]
name = "real"
[robot]
model = "ur5"
driver = "{HERE}:Arm"
connection = {{ host = "198.51.100.7" }}
speed = 0.25
position = [0.0, 0.0, 0.7]
[[camera]]
name = "c"
driver = "{HERE}:Camera"
position = [1.5, 0.0, 1.0]
look_at = [0.0, 0.0, 0.5]
"""
MORE = f"""
[[stereo]]
name = "pair"
driver = "{HERE}:Stereo"
mounted_on = "flange"
position = [0.0, 0.05, 0.03]
rpy_deg = [0, 0, 0]
[wrench]
driver = "{HERE}:Wrench"
[gripper]
driver = "{HERE}:Gripper"
opening = 0.05
[empty_switch]
driver = "{HERE}:Switch"
"""


@pytest.fixture(autouse=True)
def empty_log():
    LOG.calls.clear()


def problems(text):
    with pytest.raises(WorkcellError) as told:
        parse_workcell(text)
    return str(told.value)


def test_a_cell_of_drivers_that_are_in_no_catalogue():
    with open_cell(parse_workcell(REAL + MORE)) as cell:
        assert not cell.simulated
        assert not cell.mixed
        settings = LOG.calls[0][1]
        assert settings.connection == {"host": "198.51.100.7"}
        assert settings.velocity == pytest.approx(0.25 * cell.robot.limits.velocity)
        info = cell.cameras[0].info
        assert info.model == "double 1"
        T = inverse(cell.T_world_base) @ cell.workcell.camera[0].T_mount_camera
        assert info.T_mount_camera == pytest.approx(T)
        assert cell.stereo[0].info.mounted_on == "flange"
        assert cell.gripper.opening == 0.05
        assert len(cell.health()) == 6
    cell.close()
    assert LOG.count("stop") == 0  # nobody commanded it
    assert LOG.count("close") == 2


def test_what_was_opened_is_closed_when_a_camera_fails():
    with pytest.raises(DeviceError, match="camera 'dead': not there"):
        open_cell(parse_workcell(REAL.replace('name = "c"', 'name = "dead"')))
    assert LOG.count("close") == 1


def test_real_cameras_and_a_simulated_arm_share_the_computers_time(gl):
    text = REAL.replace(f'driver = "{HERE}:Arm"\nconnection', "connection")
    with open_cell(parse_workcell(text)) as cell:
        assert cell.mixed
        assert not cell.simulated
        assert isinstance(cell.cameras[0], DrivenCamera)
        assert cell.arm is cell.world.arm
        assert cell.show_joints is None


def test_simulated_cameras_see_a_real_arm_where_it_is(gl):
    text = REAL.replace(f'driver = "{HERE}:Camera"', 'model = "kinect_v2"')
    with open_cell(parse_workcell(text)) as cell:
        assert isinstance(cell.arm, DrivenArm)
        pictures = []
        for bend in (0.0, 0.6):
            cell.show_joints(cell.robot.home + bend)
            cell.world.advance(cell.world.clock.now() + 0.2)
            pictures.append(cell.cameras[0].read().depth)
        assert np.nanmean(np.abs(pictures[0] - pictures[1]) > 0.02) > 0.005


@pytest.mark.parametrize(("on_at", "words"), [(0.8, 1), (0.0, 0)])
def test_a_switch_that_is_turned_on_says_that_the_cell_is_empty(
    monkeypatch, tmp_path, on_at, words
):
    """One that is on from the start says nothing."""
    monkeypatch.setenv("ARMSIGHT_RUNTIME_DIR", str(tmp_path))
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "runtime"))
    from doubles import make_fake_parts

    made = []

    def make(*given):
        made.append(make_fake_parts(*given))
        return made[-1]

    switch = f'[empty_switch]\ndriver = "{HERE}:Switch"\nconnection = {{ on_at = {on_at} }}\n'
    with open_cell(parse_workcell(REAL + switch)) as cell:
        session = Session(cell, None, make=make, mode=SessionMode(look_only=True))
        session.run(2.0)
    assert made[-1].workspace.calls.count("empty") == words


# --- finding them -------------------------------------------------------------------------------


class Entry(EntryPoint):
    """An entry point of a package that is not really installed."""

    def load(self):
        if self.value == "vendor:Camera":
            raise ModuleNotFoundError("No module named 'pyvendor'", name="pyvendor")
        return plugged_doubles.Camera if self.value == "good:Camera" else 7


@pytest.fixture
def plugged(monkeypatch):
    entries = {
        name: Entry(name, value, "armsight.cameras")
        for name, value in {"good": "good:Camera", "sdk": "vendor:Camera", "seven": "x:y"}.items()
    }
    dist = SimpleNamespace(
        name="armsight-vendor", requires=["numpy", 'pyvendor>=2 ; extra == "sdk"']
    )
    monkeypatch.setattr(EntryPoint, "dist", dist)
    monkeypatch.setattr(drivers, "_plugged_in", lambda kind: entries if kind == "camera" else {})


@pytest.mark.usefixtures("plugged")
def test_entry_points_are_found_by_kind():
    assert drivers.driver_names("camera") == ("simulated", "good", "sdk", "seven")
    assert drivers.driver_names("arm") == ("simulated",)
    assert drivers.find_driver("camera", "good") is plugged_doubles.Camera
    text = REAL.replace(f"{HERE}:Arm", "good")
    assert 'robot.driver: unknown driver "good"; known: simulated' in problems(text)
    text = REAL.replace(f"{HERE}:Camera", "god")
    assert 'did you mean "good"? known: simulated, good, sdk, seven' in problems(text)


@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "sdk",
            r"No module named 'pyvendor'; install its extra: pip install 'armsight-vendor\[sdk\]'",
        ),
        ("seven", "is a int, expected a class"),
        ("nobody", r"unknown driver \"nobody\"; .*armsight.cameras"),
        ("no_such_module_xyz:Camera", "install the package that has it: no_such_module_xyz"),
        (f"{HERE}:Camra", f"module {HERE} has no Camra"),
    ],
)
def test_a_driver_that_cannot_be_had_says_what_to_do(name, words):
    with pytest.raises(DeviceError, match=words):
        drivers.find_driver("camera", name)


def test_a_module_that_is_not_there_is_told_without_running_code():
    text = REAL.replace(f"{HERE}:Camera", "no_such_module_xyz:Camera")
    assert 'camera[1] "c".driver: no module "no_such_module_xyz"' in problems(text)


@pytest.mark.parametrize("name", ["../evil:Class", "a b", ":Camera", "x:", "x:y:z", "x;y"])
def test_only_names_are_drivers(name):
    assert "driver" in problems(REAL.replace(f"{HERE}:Camera", name))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('driver = "plugged_doubles:Camera"', ""), 'camera[1] "c".model: missing'),
        (('name = "pair"', 'name = "c"'), '.name: "c" is taken by camera[1]'),
        (('driver = "plugged_doubles:Stereo"', 'model = "kinect_v2"'), "is no stereo pair"),
        (('driver = "plugged_doubles:Wrench"', 'driver = "rtde"'), "wrench.driver: unknown driver"),
        ((f'driver = "{HERE}:Switch"', ""), "empty_switch.driver: missing"),
        ((f"{HERE}:Switch", "simulated"), "empty_switch.driver: unknown driver"),
        (("opening = 0.05", "opening = 50"), "gripper.opening: found 50, expected at most 0.5"),
        (("rpy_deg = [0, 0, 0]", ""), "expected exactly one"),
    ],
)
def test_wrong_tables_of_the_new_devices(change, words):
    assert words in problems((REAL + MORE).replace(*change))


def test_a_mixed_cell_runs_on_the_computers_time(monkeypatch, tmp_path):
    """A real camera and a simulated arm: both are dated with one clock, and both go on."""
    monkeypatch.setenv("ARMSIGHT_RUNTIME_DIR", str(tmp_path))
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "runtime"))
    from doubles import make_fake_parts

    text = REAL.replace(f'driver = "{HERE}:Arm"\nconnection', "connection")
    with open_cell(parse_workcell(text + MORE)) as cell:
        session = Session(cell, None, make=make_fake_parts, mode=SessionMode(look_only=True))
        assert session.wall
        began = session.now()
        session.run(0.6)
        view = session.view()
        assert cell.world.clock.now() == pytest.approx(view.now, abs=0.3)
        for stamp in (view.joints.stamp, view.frames[0].stamp, view.reading(Wrench).stamp):
            assert began < stamp <= view.now
        assert view.reading(GripperState).width == 0.05
        session.run(0.2)
        assert session.view().joints.stamp > view.joints.stamp
        with pytest.raises(UsageError, match="second takes a second"):
            session.set_speed(2.0)
        with pytest.raises(UsageError, match="only a simulated"):
            session.reset()
