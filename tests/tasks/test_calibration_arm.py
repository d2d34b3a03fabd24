"""Cameras and the arm's errors in one calibration file do not contradict each other."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.calibration.arm import flange_poses
from armsight.calibration.robot_errors import RobotErrors
from armsight.commands import calibrate_recorded
from armsight.commands.calibrate import Calibrate
from armsight.errors import CalibrationError
from armsight.robots import load_robot
from armsight.workcell import camera_info_of, open_cell
from armsight.workcell.calibration_file.reading import calibrated_robot, read_calibration
from armsight.workcell.calibration_file.schema import CalibratedCamera
from armsight.workcell.calibration_file.store import store
from armsight.workcell.calibration_file.writing import arm_entry, camera_entry
from armsight.workcell.packaged import find, load
from armsight.workcell.schema import Workcell

NAME, CAMERA = "ur5_four_cameras", "front_left"
OFFSET = np.deg2rad([0.0, 0.2, -0.1, 0.15, 0.1, 0.0])
SHIFT = np.zeros((6, 3))


@pytest.fixture
def cell(tmp_path: Path) -> Workcell:
    """With an arm that an earlier run has found to err."""
    shutil.copy(find(NAME), tmp_path / "cell.toml")
    workcell = load(str(tmp_path / "cell.toml"))
    store(workcell, (), arm_entry(OFFSET, SHIFT, source="earlier"))
    return workcell


def _camera(workcell: Workcell) -> CalibratedCamera:
    section = next(c for c in workcell.camera if c.name == CAMERA)
    info = camera_info_of(workcell, section)
    return camera_entry(
        workcell, section, info.T_mount_camera, 1e-8 * np.eye(6), info.depth, info.color,
        info.T_depth_color, None, source="test", target_error=0.001,
    )  # fmt: skip


def _kept(
    cell: Workcell, monkeypatch: pytest.MonkeyPatch, errors: RobotErrors | None, free: bool = True
) -> None:
    """Put a set's answer into the cell's file."""
    monkeypatch.setattr(
        "armsight.tasks.calibration_entries.camera_entries", lambda *_: (_camera(cell),)
    )
    theta = None if errors is None else np.full(errors.size, 1e-4)
    answer = SimpleNamespace(
        problem=SimpleNamespace(robot=errors, rigs=(None,)),
        freedom=SimpleNamespace(robot=free),
        solution=SimpleNamespace(state=SimpleNamespace(theta=theta)),
    )
    robot = None if errors is None else "ur5"
    asked = Calibrate(str(cell.file), from_=Path("set"), camera=CAMERA, robot=robot)
    calibrate_recorded._keep(asked, answer)  # type: ignore[arg-type]


def test_the_sphere_is_shown_by_the_arm_as_the_file_has_it(
    cell: Workcell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was solved with the nominal arm, and used with the other one."""
    q = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    with open_cell(cell) as used:
        expected = flange_poses(used.robot, q)
    seen = {}

    def setup(opened: object, *_: object) -> None:
        seen["robot"] = opened.robot  # type: ignore[attr-defined]
        raise CalibrationError("enough")

    monkeypatch.setattr("armsight.tasks.calibrate_sphere.sphere_setup", setup)
    with pytest.raises(CalibrationError, match="enough"):
        Calibrate(str(cell.file), sphere=True, headless=True).run()
    np.testing.assert_allclose(flange_poses(seen["robot"], q), expected, atol=1e-12)
    assert np.abs(expected - flange_poses(load_robot("ur5"), q)).max() > 1e-3


def test_what_a_set_finds_of_the_arm_is_kept_with_its_cameras(
    cell: Workcell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cameras were written, and the arm that they were solved with was not."""
    nominal = load_robot("ur5")
    assert cell.calibration_file is not None
    errors = RobotErrors(calibrated_robot(nominal, read_calibration(cell.calibration_file)))
    _kept(cell, monkeypatch, errors)
    written = read_calibration(cell.calibration_file)
    q = np.random.default_rng(2).uniform(-2, 2, (20, 6))
    theta = np.full(errors.size, 1e-4)
    theta[-len(errors.sag_joints) :] = 0.0  # a cell's arm is stiff
    expected, _ = errors.flange_poses(q, theta)
    np.testing.assert_allclose(
        flange_poses(calibrated_robot(nominal, written), q), expected, atol=1e-9
    )
    found = written.of(CAMERA)
    assert found is not None
    np.testing.assert_allclose(found.C, 1e-8 * np.eye(6))
    # Where the set finds nothing of the arm, what it was solved with stays.
    _kept(cell, monkeypatch, errors, free=False)
    assert read_calibration(cell.calibration_file).arm == written.arm


def test_cameras_found_by_poses_alone_are_as_unsure_as_the_arms_correction(
    cell: Workcell, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They stood there to 0.1 mm beside an arm that moves by millimetres."""
    assert cell.calibration_file is not None
    nominal, file = load_robot("ur5"), cell.calibration_file
    used = calibrated_robot(nominal, read_calibration(file))
    _kept(cell, monkeypatch, None)
    assert "corrects the arm by" in capsys.readouterr().out
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (400, 6))
    gap = (flange_poses(used, q) - flange_poses(nominal, q))[:, :3, 3]
    off = float(np.sqrt(np.mean(np.sum(gap**2, axis=1))))
    assert off > 1e-3
    found = read_calibration(file).of(CAMERA)
    assert found is not None
    assert np.sqrt(np.trace(found.C[:3, :3])) == pytest.approx(off, rel=0.15)
    assert found.target_error == pytest.approx(np.hypot(0.001, off), rel=0.15)
    assert read_calibration(file).arm is not None


def test_a_cell_without_an_arms_errors_keeps_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(find(NAME), tmp_path / "cell.toml")
    cell = load(str(tmp_path / "cell.toml"))
    _kept(cell, monkeypatch, None)
    assert "corrects" not in capsys.readouterr().out
    assert cell.calibration_file is not None
    found = read_calibration(cell.calibration_file).of(CAMERA)
    assert found is not None
    np.testing.assert_allclose(found.C, 1e-8 * np.eye(6))
