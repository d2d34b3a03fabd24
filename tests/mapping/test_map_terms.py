"""What a snapshot says of time, cameras and tolerances, on a cell whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.geometry.pose import from_rpy
from armsight.mapping.config import MappingConfig
from armsight.mapping.health import CameraHealth
from armsight.mapping.snapshot import FREE, OCCUPIED
from armsight.mapping.workspace_map import QUIET, WorkspaceMap

from . import scenes

CONFIG = MappingConfig(lower=(-0.8, -0.8, -0.1), upper=(0.8, 0.8, 0.9), voxel=0.04, align=False)
TABLE = scenes.box("table", (0, 0, -0.05), (4.0, 4.0, 0.1))
Q = np.array([0.5, -0.3])
ROBOT = scenes.two_link_arm()
SOLIDS = [TABLE, *scenes.arm_solids(ROBOT, Q)]
JOINTS = scenes.resting(Q)
LEFT = scenes.camera_info("left", (1.0, 1.0, 1.4))
RIGHT = scenes.camera_info("right", (1.0, -1.0, 1.4))
PICTURE = {c.name: scenes.ray_cast(c.depth, c.T_mount_camera, SOLIDS) for c in (LEFT, RIGHT)}


def frame(info, stamp, sequence):
    return scenes.frame(info, stamp, PICTURE[info.name], sequence)


def two(config=CONFIG):
    return WorkspaceMap(ROBOT, [LEFT, RIGHT], [TABLE], config)


@pytest.mark.parametrize("order", [1, -1])
def test_a_snapshot_is_as_new_as_its_newest_picture_and_as_old_as_its_oldest(order):
    snapshot = two().update([frame(LEFT, 0.13, 0), frame(RIGHT, 0.11, 0)][::order], JOINTS, 0.14)
    assert (snapshot.stamp, snapshot.oldest) == (0.13, 0.11)
    assert [c.stamp for c in snapshot.cameras] == [0.13, 0.11]


@pytest.mark.parametrize("threads", [0, 1, 2])
def test_however_many_threads_there_are_the_map_is_the_same(threads):
    one, other = two(), two(replace(CONFIG, threads=threads))
    frames = [frame(LEFT, 0.13, 0), frame(RIGHT, 0.11, 0)]
    a, b = (m.update(frames, JOINTS, 0.14) for m in (one, other))
    assert (a.state == FREE).sum() > 1000
    for name in ("state", "distance", "hazards", "cloud", "last_occupied"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    one.close()
    other.close()


def test_without_pictures_the_last_snapshot_stands_for_a_moment():
    world = two()
    frames = [frame(LEFT, 0.1, 0), frame(RIGHT, 0.1, 0)]
    first = world.update(frames, JOINTS, 0.11)
    again = world.update([], JOINTS, 0.11 + 0.5 * QUIET)
    assert again.sequence == first.sequence
    assert again.hazards is first.hazards
    later = world.update([], JOINTS, 0.11 + 1.1 * QUIET)
    assert later.sequence == first.sequence + 1
    assert world.update([], JOINTS, 0.105 + 1.1 * QUIET).sequence > later.sequence, "turned back"


def test_when_one_camera_of_two_dies_the_map_is_made_anew_at_once():
    world = two()
    both = world.update([frame(LEFT, 0.1, 0), frame(RIGHT, 0.1, 0)], JOINTS, 0.11)
    for k in (1, 2, 3):
        now = 0.1 + 0.03 * k
        one = world.update([frame(LEFT, now, k)], JOINTS, now + 0.005)
    assert one.cameras[1].alive
    assert (one.state == FREE).sum() == (both.state == FREE).sum()
    dead = world.update([], JOINTS, 0.1 + CONFIG.stale_after + 0.001)
    assert dead.sequence == one.sequence + 1
    assert not dead.cameras[1].alive
    assert (dead.state == FREE).sum() < (both.state == FREE).sum()


def test_people_move_through_unseen_space_for_the_time_that_has_passed():
    """Longer between two looks, farther: half a pocket in half the time."""
    filled = []
    for wait in (0.05, 0.1, 0.2):
        world = WorkspaceMap(ROBOT, [LEFT], [TABLE], CONFIG)
        for k, now in enumerate((0.1, 0.13)):
            world.update([frame(LEFT, now, k)], JOINTS, now + 0.001)
        people = world._people.fine.unseen
        people.nobody()
        snapshot = world.update([frame(LEFT, 0.13 + wait, 3)], JOINTS, 0.131 + wait)
        assert snapshot.cameras[0].alive
        filled.append(int(people.mask().sum()))
    assert 0 < filled[0] < filled[1] < filled[2]


@pytest.mark.parametrize(("error", "explained"), [(0.03, True), (0.0005, False)])
def test_what_calibration_leaves_is_neither_arm_nor_table_beside_themselves(error, explained):
    """A camera that sits 25 mm and half a degree from where it is said to: told so, or not."""
    off = from_rpy((0.008, -0.008, 0.0), (0.015, -0.015, 0.015))
    true = LEFT.T_mount_camera @ off
    depth = scenes.ray_cast(LEFT.depth, true, SOLIDS)
    config = replace(CONFIG, calibration_m=error, calibration_rad=error / 2.0, voxel=0.02)
    world = WorkspaceMap(ROBOT, [LEFT], [TABLE], config)
    for k in range(4):
        now = 0.1 + 0.033 * k
        snapshot = world.update([scenes.frame(LEFT, now, depth, k)], JOINTS, now + 0.001)
    above = snapshot.cloud[snapshot.cloud[:, 2] > 0.1]
    on_table = snapshot.cloud[snapshot.cloud[:, 2] <= 0.1]
    assert (len(above) == 0) == explained
    assert (len(on_table) == 0) == explained
    assert (snapshot.state == OCCUPIED).any(), "the table is where it is declared"


@pytest.mark.parametrize(
    ("rate", "latency", "age"),
    [(30.0, 0.0, 0.1), (15.0, 0.04, 0.04 + 1 / 6), (5.0, 0.04, 0.54), (0.0, 0.3, 0.3)],
)
def test_a_camera_is_alive_for_its_latency_and_two_and_a_half_periods(rate, latency, age):
    info = replace(LEFT, rate=rate, latency=latency)
    health = CameraHealth(info, CONFIG)
    assert not health.alive(0.0)
    health.accept(frame(LEFT, 5.0, 3))
    for now, alive in (
        (5.0 - CONFIG.future - 0.001, False),
        (5.0 - CONFIG.future + 0.001, True),
        (5.0 + age - 0.001, True),
        (5.0 + age + 0.001, False),
    ):
        assert health.alive(now) == alive
        assert health.status(now).alive == alive
    assert not health.status(5.0, "moved").alive


def test_what_is_said_of_a_camera_is_its_newest_trouble():
    health = CameraHealth(LEFT, CONFIG)
    assert health.status(1.0).reason == "no frame yet"
    health.refuse("why")
    assert health.status(1.0).reason == "no frame yet; last one refused: why"
    health.accept(frame(LEFT, 1.0, 0), "odd")
    assert health.status(1.01).reason == "odd"
    health.refuse("why not")
    assert health.status(1.01).reason == "why not"
    assert health.status(1.5).reason == "newest frame is 0.50 s old; last one refused: why not"
    health.accept(frame(LEFT, 1.6, 1))
    assert health.status(1.61).reason == ""


def test_lost_frames_are_counted_from_the_second_on():
    health = CameraHealth(LEFT, CONFIG)
    dropped = []
    for k, sequence in enumerate((7, 8, 11, 12, 0, 1, 3)):
        health.accept(frame(LEFT, 1.0 + k, sequence))
        dropped.append(health.status(1.0 + k).dropped)
    assert dropped == [0, 0, 2, 2, 2, 2, 3]
    health.restart("was calibrated again")
    health.accept(frame(LEFT, 9.0, 40))
    assert health.status(9.0).dropped == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lower", (np.nan, 0.0, 0.0)),
        ("far_upper", (np.nan, 0.0, 0.0)),
        ("stale_after", np.inf),
        ("person_speed", np.nan),
        ("person_speed", -2.0),
        ("hold", -0.1),
        ("self_margin", np.nan),
        ("support", -1),
        ("up", (0.0, 0.0, 0.0)),
    ],
)
def test_settings_that_no_map_can_keep_are_named(name, value):
    """A comparison with NaN is false: such a map would free, or hold for ever, without a word."""
    with pytest.raises(UsageError, match=f"mapping.{name} is "):
        replace(CONFIG, **{name: value})
