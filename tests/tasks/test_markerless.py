"""Calibration by the arm itself: which views are kept, what is written, and the whole of it."""

import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.recognition.own_arm.synthetic import LENS, T_BASE_CAMERA, corners, robot, splatted_depth

from armsight.commands.calibrate_markerless import calibrate_markerless
from armsight.devices.camera_models import camera_info
from armsight.devices.data import JointState, RgbdFrame
from armsight.errors import TaskError, UsageError
from armsight.geometry.pose import inverse
from armsight.motion.perception import PosedFrame
from armsight.recognition.own_arm import DepthView, OwnArmPose
from armsight.robots.robot import Robot
from armsight.tasks.markerless import ArmViews, between, entry_of, find_camera
from armsight.workcell import open_cell
from armsight.workcell.beliefs import robot_in
from armsight.workcell.packaged import find, load

INFO = replace(
    camera_info("left", "kinect_v2", "base", T_BASE_CAMERA @ inverse(np.eye(4))), depth=LENS
)


def posed(q: np.ndarray, speed: float = 0.0, stamp: float = 1.0) -> PosedFrame:
    depth = np.full((LENS.height, LENS.width), 2.0, np.float32)
    frame = RgbdFrame("left", 0, stamp, stamp, depth)
    return PosedFrame(frame, INFO, JointState(stamp, q, np.full(6, speed)), T_BASE_CAMERA)


def test_views_are_of_a_slow_arm_in_new_poses() -> None:
    views = ArmViews(["left"], wanted=3)
    q = np.zeros(6)
    assert views.update([posed(q)]) is not None
    views.update([posed(q + 0.1)])  # nearly the same
    views.update([posed(q + 0.5, speed=1.0)])  # too fast
    views.update([replace(posed(q + 0.5), joints=None)])
    assert len(views.views["left"]) == 1
    seen = views.update([posed(q + 0.5, stamp=2.0)])
    assert seen is not None
    assert seen.views == {"left": 2}
    assert seen.stamp == 2.0
    assert not views.complete
    views.update([posed(q + 1.0)])
    views.update([posed(q + 1.5)])
    assert views.complete
    assert len(views.views["left"]) == 3
    assert views.update([]) is None
    views.reset()
    assert not views.views["left"]


def test_stops_lie_between_the_goals() -> None:
    goals = {"A": np.zeros(2), "B": np.array([3.0, -3.0])}
    stops = between(goals, 3)
    assert next(iter(stops)) == "A"
    assert len(stops) == 6
    assert np.allclose(stops["B"], [3.0, -3.0])
    assert np.allclose(sorted(s[0] for s in stops.values()), [0, 1, 1, 2, 2, 3])


def test_a_bumped_camera_is_placed_and_written() -> None:
    arm = robot()
    turns = ([0, 0, 0, 0, 0, 0], [0.9, 0.3, -0.4, 0.3, 0.5, 0], [-0.8, -0.3, 0.6, -0.5, 0.2, 0.4])
    views = []
    for k, turn in enumerate(turns):
        q = arm.home + np.array(turn, float)
        views.append(DepthView(q, splatted_depth(corners(arm, q), T_BASE_CAMERA, LENS, k)))
    bumped = T_BASE_CAMERA.copy()
    bumped[:3, 3] += [0.03, -0.02, 0.02]
    answer = find_camera(arm, replace(INFO, T_mount_camera=bumped), views)
    assert answer.believed
    assert np.linalg.norm(answer.T_base_camera[:3, 3] - T_BASE_CAMERA[:3, 3]) < 0.015


def test_an_entry_keeps_the_lenses_and_says_where_it_came_from() -> None:
    workcell = load("ur5_four_cameras")
    section = workcell.camera[0]
    info = camera_info(section.name, section.model, "base", np.eye(4))
    answer = OwnArmPose(T_BASE_CAMERA, 1e-7 * np.eye(6), 1e-3, 0.9, 0.8, 0.002, 5)
    entry = entry_of(workcell, info, robot_in(workcell), answer)
    assert entry.name == section.name
    assert np.allclose(entry.position, T_BASE_CAMERA[:3, 3])
    assert "markerless, 5 views" in entry.source
    # What the arm is off by itself is in it, though no pixel knows.
    assert entry.covariance[0][0] > 2e-6
    assert entry.depth_lens.fx == pytest.approx(info.depth.fx)


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(UsageError, match='no fixed camera "nobody"; it has front_left'):
        calibrate_markerless("ur5_four_cameras", "nobody", 0, False)


@pytest.mark.slow  # half a minute of a simulated cell
def test_a_cell_is_calibrated_by_its_arm(gl: str, tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    shutil.copy(find("ur5_four_cameras"), file)
    assert calibrate_markerless(str(file), "front_left", 0, True) == 0
    with open_cell(load(str(file)), 0) as cell:
        assert cell.world is not None
        T = inverse(cell.T_world_base) @ cell.world.cameras[0].T_mount_camera
        off = cell.cameras[0].info.T_mount_camera @ inverse(T)
    points = np.array([[0.3, 0.2, 0.3, 1], [0.3, -0.2, 0.5, 1], [-0.2, 0.0, 0.6, 1]])
    assert np.linalg.norm((points @ off.T - points)[:, :3], axis=1).max() < 0.01


class _Ended:
    """A session that is over."""

    def __init__(self, ended_by: str, task_failure: str = "") -> None:
        self.ended_by, self.task_failure = ended_by, task_failure


def opened(monkeypatch: pytest.MonkeyPatch, session: _Ended, arm: Robot) -> None:
    """A cell without a simulation, whose session ends at once; nothing may be solved."""

    class Cell:
        simulated, cameras, robot = True, (), arm

    def solved(*_: object) -> None:
        raise AssertionError("the views were solved")

    monkeypatch.setattr("armsight.workcell.open_cell", lambda *_: nullcontext(Cell()))
    monkeypatch.setattr("armsight.commands.running.run_session", lambda *_: session)
    monkeypatch.setattr("armsight.tasks.markerless.find_camera", solved)


def test_what_was_interrupted_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened(monkeypatch, _Ended("interrupted"), robot())
    assert calibrate_markerless("ur5_four_cameras", "front_left", 0, True) == 130
    assert capsys.readouterr().out == "stopped; nothing was changed\n"


def test_a_patrol_that_failed_is_told_by_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    opened(monkeypatch, _Ended("task failed", "the goals cannot be reached"), robot())
    with pytest.raises(TaskError, match="the goals cannot be reached"):
        calibrate_markerless("ur5_four_cameras", "front_left", 0, True)


def test_an_arm_without_a_shape_is_refused_before_it_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    opened(monkeypatch, _Ended("time"), replace(robot(), meshes=()))
    with pytest.raises(UsageError, match="no meshes"):
        calibrate_markerless("ur5_four_cameras", "front_left", 0, True)
