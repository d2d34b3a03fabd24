"""A camera that was walked into is placed by what it sees of the arm, and only when told to."""

from dataclasses import replace

import numpy as np
import pytest
from tests.recognition.own_arm.synthetic import LENS, T_BASE_CAMERA, corners, robot, splatted_depth

from armsight.devices.camera_models import camera_info
from armsight.devices.data import JointState, RgbdFrame
from armsight.motion.perception import PosedFrame
from armsight.tasks.arm_watch import ArmWatch

SIGMA = np.diag([0.002**2] * 3 + [0.001**2] * 3)
TURNS = ([0, 0, 0, 0, 0, 0], [0.9, 0.3, -0.4, 0.3, 0.5, 0], [-0.8, -0.3, 0.6, -0.5, 0.2, 0.4])
MOVED = np.array([0.03, -0.02, 0.02])
BEFORE = T_BASE_CAMERA.copy()
BEFORE[:3, 3] += MOVED
INFO = replace(camera_info("left", "kinect_v2", "base", BEFORE), depth=LENS, covariance=SIGMA)


@pytest.fixture(scope="module")
def frames() -> list[PosedFrame]:
    """What the camera sees from where it truly stands now."""
    arm = robot()
    found = []
    for k, turn in enumerate(TURNS):
        q = arm.home + np.array(turn, float)
        depth = splatted_depth(corners(arm, q), T_BASE_CAMERA, LENS, k)
        frame = RgbdFrame("left", k, float(k), float(k), depth)
        found.append(PosedFrame(frame, INFO, JointState(float(k), q, np.zeros(6)), BEFORE))
    return found


def test_a_camera_that_nobody_doubts_is_left_alone(frames: list[PosedFrame]) -> None:
    watch = ArmWatch(robot(), [INFO])
    watch.doubted("another", True)
    assert [watch.update([f]) for f in frames] == [None] * len(frames)


def test_a_doubted_camera_is_placed_where_it_stands_now(frames: list[PosedFrame]) -> None:
    watch = ArmWatch(robot(), [INFO])
    watch.doubted("left", False)
    said = [watch.update([f]) for f in frames]
    assert all(s is not None for s in said)
    first, last = said[0], said[-1]
    assert first is not None
    assert last is not None
    assert first.placed == ()
    ((name, reason),) = first.excluded
    assert name == "left"
    assert "was moved" in reason
    assert last.excluded == ()
    assert last.stamp == len(frames) - 1
    (found,) = last.placed
    away = np.linalg.norm(found.T_mount_camera[:3, 3] - T_BASE_CAMERA[:3, 3])
    assert away < 0.4 * np.linalg.norm(MOVED)
    assert found.depth is INFO.depth
    assert found.covariance is not None
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    assert "calibrated again" in last.warning
    # It is done with that camera until it is told once more.
    assert watch.update([frames[0]]) is None


def test_a_camera_that_stands_where_it_did_is_not_blamed(frames: list[PosedFrame]) -> None:
    still = replace(INFO, T_mount_camera=T_BASE_CAMERA)
    watch = ArmWatch(robot(), [still])
    watch.doubted("left", False)
    there = [replace(f, info=still, T_base_camera=T_BASE_CAMERA) for f in frames]
    said = [watch.update([f]) for f in there]
    assert all(s is not None and not s.excluded and not s.placed for s in said)
    # Whoever else has excluded it knows better: it is placed, and counts again.
    watch.doubted("left", True)
    last = [watch.update([f]) for f in there][-1]
    assert last is not None
    assert [i.name for i in last.placed] == ["left"]
    watch.reset()
    assert watch.update([frames[0]]) is None


def test_an_arm_that_cannot_move_places_a_camera_from_one_view(frames: list[PosedFrame]) -> None:
    watch = ArmWatch(robot(), [INFO])
    watch.doubted("left", False)
    first = watch.update([frames[0]])
    assert first is not None
    assert first.excluded
    assert not first.placed

    def later(stamp: float) -> PosedFrame:
        return replace(frames[0], frame=replace(frames[0].frame, stamp=stamp))

    soon, late = watch.update([later(3.0)]), watch.update([later(6.0)])
    assert soon is not None
    assert late is not None
    assert soon.excluded
    assert not soon.placed
    assert not late.excluded
    assert [i.name for i in late.placed] == ["left"]
