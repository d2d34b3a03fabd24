"""The watch that looks at the board in passing: a print, warped as each lens sees it."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armsight.calibration import arm
from armsight.calibration.boards import parse_board, raster
from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, RgbdFrame
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose, transform
from armsight.motion.perception import PosedFrame
from armsight.robots import load_robot
from armsight.tasks.board_watch import SCALE, BoardWatch

ROBOT = load_robot("ur5")
BOARD = parse_board("checkerboard:7x5:30")
REST = np.deg2rad([[-60, -110, 120, -180, -30, 0], [-50, -100, 110, -180, -40, 10],
                   [-65, -105, 115, -170, -35, 0], [-55, -115, 125, -185, -30, 5]])  # fmt: skip
LENS = PinholeCamera(1920, 1080, 1060.0, 1060.0, 959.5, 539.5)
SIGMA = np.diag([0.001**2] * 3 + [0.0005**2] * 3)
PER_METER = 3000


def board_at(joints):
    """``T_base_board``: what the flange carries, its print away from the arm."""
    middle = 0.5 * (BOARD.points.max(0) + BOARD.points.min(0))
    T = make_pose(Rotation.from_euler("x", 180, degrees=True).as_matrix(), [0, 0, 0.06])
    T_flange_board = T @ make_pose(None, -middle)
    return arm.flange_poses(ROBOT, joints[None])[0] @ T_flange_board, T_flange_board


def facing(side):
    """A camera 1 m before the board at the first rest, a little to one side."""
    T_base_board, _ = board_at(REST[0])
    T = T_base_board @ make_pose(Rotation.from_euler("y", side).as_matrix(), np.zeros(3))
    return T @ make_pose(None, [0, 0, -1.0])


def camera(name, side):
    return RgbdCameraInfo(
        name, "test", LENS.scaled(0.25), LENS, np.eye(4), "base", facing(side), 15.0, 0.04,
        (0.5, 4.5), DepthNoise(0.001, 0.0, 0.0), covariance=SIGMA,
    )  # fmt: skip


INFOS = [camera("left", -0.25), camera("right", 0.25)]


def picture(T_base_camera, joints, lens):
    """The board through the lens: its print warped by the homography of its plane."""
    image, x0, y0 = raster(BOARD, PER_METER, 0.02)
    T = inverse(T_base_camera) @ board_at(joints)[0]
    h, w = image.shape
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], float)
    on_board = np.column_stack([corners / PER_METER + [x0, y0], np.zeros(4)])
    H = cv2.getPerspectiveTransform(
        (corners - 0.5).astype(np.float32), lens.project(transform(T, on_board)).astype(np.float32)
    )
    gray = cv2.warpPerspective(
        image, H, (lens.width, lens.height), flags=cv2.INTER_AREA, borderValue=120
    )
    return np.repeat(cv2.GaussianBlur(gray, (0, 0), 0.7)[..., None], 3, axis=2)


def frame(info, stamp, joints, T_true, velocity=0.0):
    lens = info.color.scaled(SCALE)
    color = picture(T_true, joints, lens)
    depth = np.full((info.depth.height, info.depth.width), np.nan, np.float32)
    state = JointState(stamp, joints, np.full(6, velocity))
    raw = RgbdFrame(info.name, round(stamp * 15), stamp, stamp, depth, color)
    return PosedFrame(raw, info, state, info.T_mount_camera, lens)


def watched(moved, rests=REST, velocity=0.0):
    """What is published after the rests; ``moved`` displaces cameras by name."""
    watch = BoardWatch(ROBOT, BOARD, board_at(REST[0])[1], INFOS)
    said = []
    for k, joints in enumerate(rests):
        frames = [
            frame(i, 5.0 * k, joints, i.T_mount_camera @ moved.get(i.name, np.eye(4)), velocity)
            for i in INFOS
        ]
        said.append(watch.update(frames))
    return watch, said


def test_a_cell_that_stands_still_is_believed():
    _, said = watched({})
    assert all(s is not None for s in said)
    assert said[-1].sightings == 2 * len(REST)
    assert said[-1].excluded == ()
    assert said[-1].warning == ""


@pytest.mark.parametrize("moved", [
    make_pose(None, [0.02, 0.0, 0.0]),
    make_pose(Rotation.from_euler("z", 2, degrees=True).as_matrix(), np.zeros(3)),
    make_pose(Rotation.from_euler("y", 1, degrees=True).as_matrix(), np.zeros(3)),
])  # fmt: skip
def test_a_camera_that_was_moved_is_named_and_excluded_with_what_to_do(moved):
    _, said = watched({"right": moved})
    assert [name for name, _ in said[-1].excluded] == ["right"]
    assert "calibrate it again" in dict(said[-1].excluded)["right"]


def test_one_sighting_blames_nobody():
    _, said = watched({"right": make_pose(None, [0.02, 0.0, 0.0])}, REST[:1])
    assert said[-1].excluded == ()


def test_the_board_that_slipped_is_a_warning_and_no_camera_s_fault(monkeypatch):
    slip = make_pose(None, [0.02, 0.01, 0.0])
    monkeypatch.setattr(f"{__name__}.board_at", lambda q, at=board_at: (at(q)[0] @ slip, at(q)[1]))
    _, said = watched({})
    assert said[-1].excluded == ()
    assert "board slipped on the flange" in said[-1].warning


def test_a_moving_arm_teaches_nothing():
    _, said = watched({}, velocity=0.05)
    assert said == [None] * len(REST)


def test_one_rest_counts_once_however_often_it_is_photographed():
    watch = BoardWatch(ROBOT, BOARD, board_at(REST[0])[1], INFOS)
    first = watch.update([frame(INFOS[0], 1.0, REST[0], INFOS[0].T_mount_camera)])
    again = watch.update([frame(INFOS[0], 1.5, REST[0], INFOS[0].T_mount_camera)])
    assert first.sightings == 1
    assert again is None
    watch.reset()
    assert watch.update([frame(INFOS[0], 2.0, REST[0], INFOS[0].T_mount_camera)]).sightings == 1


def test_a_board_that_is_turned_away_is_not_looked_for():
    away = np.deg2rad([-60, -110, 120, -100, -90, 0])
    _, said = watched({}, rests=[away])
    assert said == [None]
