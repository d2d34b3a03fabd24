"""The whole chain on a synthetic cell with known truth."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes

CONFIG = MappingConfig(lower=(-0.8, -0.8, -0.1), upper=(0.8, 0.8, 0.9), align=False)
TABLE = scenes.box("table", (0, 0, -0.05), (4.0, 4.0, 0.1))
BALL = scenes.sphere("ball", (0.3, -0.4, 0.3), 0.08)
Q = np.array([0.5, -0.3])


@pytest.fixture(scope="module")
def cameras():
    return [
        scenes.camera_info("left", (1.0, 1.0, 1.4)),
        scenes.camera_info("right", (1.0, -1.0, 1.4)),
        scenes.camera_info("back", (-1.2, 0.1, 1.4)),
    ]


def frames_of(cameras, solids, stamp, sequence=0):
    return [
        scenes.frame(c, stamp, scenes.ray_cast(c.depth, c.T_mount_camera, solids), sequence)
        for c in cameras
    ]


@pytest.fixture
def cell(cameras):
    robot = scenes.two_link_arm()
    with_arm = [TABLE, *scenes.arm_solids(robot, Q)]
    return robot, with_arm, WorkspaceMap(robot, cameras, [TABLE], CONFIG), scenes.resting(Q)


def test_arm_is_no_obstacle_and_ball_is(cell, cameras):
    _robot, solids, world, joints = cell
    snapshot = world.update(frames_of(cameras, solids, 0.1), joints, 0.11)
    assert not (~snapshot.hazard_unknown).any()  # nothing but arm and table: nothing seen
    snapshot = world.update(frames_of(cameras, [*solids, BALL], 0.2, 1), joints, 0.21)
    seen = snapshot.hazards[~snapshot.hazard_unknown]
    assert len(seen) > 50
    gap = np.abs(BALL.distance(seen))
    assert gap.max() <= snapshot.hazard_radius + 1e-6


def test_states_agree_with_truth(cell, cameras):
    _robot, solids, world, joints = cell
    snapshot = world.update(frames_of(cameras, [*solids, BALL], 0.1), joints, 0.11)
    index = np.argwhere(snapshot.state == FREE)
    centers = snapshot.grid.center(index)
    for solid in [*solids, BALL]:
        # a free voxel lies wholly outside every solid
        assert solid.distance(centers).min() > 0
    assert (snapshot.state == FREE).mean() > 0.5
    below = snapshot.grid.center(np.argwhere(snapshot.state == OCCUPIED))[:, 2] < 0
    assert below.any()


def test_the_cloud_ends_at_crop_and_the_hazards_do_not(cell, cameras):
    robot, solids, _world, joints = cell
    distance = np.linalg.norm(BALL.T_frame_solid[:3, 3])
    world = WorkspaceMap(robot, cameras, [TABLE], replace(CONFIG, crop=distance))
    snapshot = world.update(frames_of(cameras, [*solids, BALL], 0.1), joints, 0.11)
    shown = np.linalg.norm(snapshot.cloud, axis=1)
    seen = np.linalg.norm(snapshot.hazards[~snapshot.hazard_unknown], axis=1)
    assert 0 < len(shown) < len(seen)
    assert shown.max() <= distance < seen.max()


def test_departed_ball_is_cleared_by_next_frames(cell, cameras):
    _robot, solids, world, joints = cell
    world.update(frames_of(cameras, [*solids, BALL], 0.1), joints, 0.11)
    snapshot = world.update(frames_of(cameras, solids, 0.133, 1), joints, 0.15)
    snapshot = world.update(frames_of(cameras, solids, 0.166, 2), joints, 0.18)
    assert not (~snapshot.hazard_unknown).any()


def test_everything_is_unknown_before_the_first_frame(cell):
    world, joints = cell[2], cell[3]
    snapshot = world.update([], joints, 0.0)
    assert (snapshot.state != FREE).all()
    assert (snapshot.state == UNKNOWN).any()
    assert not any(c.alive for c in snapshot.cameras)
    assert snapshot.oldest == -np.inf


def test_dead_cameras_take_their_free_space_with_them(cell, cameras):
    _robot, solids, world, joints = cell
    world.update(frames_of(cameras, [*solids, BALL], 0.1), joints, 0.11)
    snapshot = world.update([], joints, 1.0)
    assert not (snapshot.state == FREE).any()
    assert (~snapshot.hazard_unknown).any()  # what was seen occupied stays
    assert all("old" in c.reason for c in snapshot.cameras)


def test_a_camera_that_is_placed_again_frees_space_from_its_new_pose(cell, cameras):
    _robot, solids, world, joints = cell
    first = cameras[0]
    push = np.eye(4)
    push[:3, 3] = [0.05, 0.02, -0.03]
    moved = replace(first, T_mount_camera=first.T_mount_camera @ push)
    true = [moved, *cameras[1:]]
    world.exclude(first.name, "was moved")
    snapshot = world.update(frames_of(true, solids, 0.1), joints, 0.11)
    assert snapshot.cameras[0].excluded
    without = (snapshot.state == FREE).sum()
    world.place(moved)
    snapshot = world.update(frames_of(true, solids, 0.133, 1), joints, 0.15)
    assert snapshot.cameras[0].alive
    assert not snapshot.cameras[0].excluded
    assert (snapshot.state == FREE).sum() > without
    # What the page draws is told beside the pose that the cell began with.
    np.testing.assert_allclose(snapshot.corrections[0].T_believed_corrected, push, atol=0.01)
    np.testing.assert_allclose(snapshot.corrections[1].T_believed_corrected, np.eye(4), atol=0.01)


def test_a_camera_that_was_moved_is_gone_on_without():
    """Excluded, not dead: what it saw frees nothing any more; the guard does not wait for it."""
    from armsight.mapping.snapshot import CameraStatus
    from armsight.motion.faults import FaultWatch
    from armsight.motion.guard_config import GuardConfig

    moved = CameraStatus("cam", 1.0, False, 1, 0, "was moved", excluded=True)
    info = scenes.camera_info("cam")
    watch = FaultWatch(scenes.two_link_arm(), [info], GuardConfig())

    class Seen:
        cameras = (moved, CameraStatus("other", 1.0, True, 1, 0))

    assert watch._cameras(1.0, Seen)[1] == ""
    Seen.cameras = (moved,)
    assert "no camera can be trusted: cam was moved" in watch._cameras(1.0, Seen)[1]
