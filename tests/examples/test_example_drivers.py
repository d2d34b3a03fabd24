"""The two drivers of the examples conform, are short, and run a cell against their doubles."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "runtime"))
from doubles import make_fake_parts

from armsight.devices.conformance import failures
from armsight.devices.port import ArmSettings, CameraSettings
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.workcell import open_cell, parse_workcell

DRIVERS = Path(__file__).resolve().parents[2] / "examples" / "drivers"


@pytest.fixture
def doubles(monkeypatch):
    monkeypatch.syspath_prepend(str(DRIVERS))
    import device_doubles

    return device_doubles


@pytest.mark.parametrize(("name", "most"), [("tcp_camera.py", 60), ("tcp_arm.py", 80)])
def test_they_are_short(name, most):
    assert len((DRIVERS / name).read_text(encoding="utf-8").splitlines()) <= most


def test_the_camera_conforms(doubles):
    from tcp_camera import Camera

    settings = CameraSettings("c", {"port": doubles.serve(0, doubles.camera)})
    assert [w for w in failures("camera", Camera, settings, seconds=0.6) if w.title != "rate"] == []


def test_the_arm_conforms(doubles):
    from tcp_arm import Arm

    settings = ArmSettings(
        "a", {"port": doubles.serve(0, doubles.arm, {})}, tuple("abcdef"), np.ones(6), np.ones(6),
        250.0, 0.2,
    )  # fmt: skip
    assert failures("arm", Arm, settings, seconds=0.5, commands=True) == []


def test_the_cell_of_both_can_be_looked_at_without_a_command(doubles, tmp_path, monkeypatch):
    monkeypatch.setenv("ARMSIGHT_RUNTIME_DIR", str(tmp_path))
    state: dict[str, object] = {}
    ports = doubles.serve(0, doubles.camera), doubles.serve(0, doubles.arm, state)
    text = (DRIVERS / "cell.toml").read_text(encoding="utf-8")
    text = text.replace("7001", str(ports[0])).replace("7002", str(ports[1]))
    with open_cell(parse_workcell(text)) as cell:
        session = Session(cell, None, make=make_fake_parts, mode=SessionMode(look_only=True))
        session.run(0.5)
        view = session.view()
    assert view.joints.position == pytest.approx(np.deg2rad(doubles.HOME_DEG))
    assert view.frames[0].depth.shape == (doubles.HEIGHT, doubles.WIDTH)
    assert {device.stage for device in view.devices} == {"open"}
    assert "commands" not in state
