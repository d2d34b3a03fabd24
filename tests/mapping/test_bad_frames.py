"""Frames that cannot be used: each has an answer, a reason in words, and frees nothing."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import DepthNoise, JointState
from armsight.devices.history import JointHistory
from armsight.errors import UsageError
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes
from .test_map_oracle import CONFIG, JOINTS, TABLE, camera

BALL = scenes.sphere("ball", (10.3, 0.0, 0.25), 0.1)
WALL = scenes.box("wall", (8.6, 0.0, 0.0), (0.1, 6.0, 6.0))
INFO = camera("a", (11.3, 0.4, 0.9), 128)


def picture(*things, info=INFO):
    return scenes.ray_cast(info.depth, info.T_mount_camera, [WALL, TABLE, *things])


@pytest.fixture
def world():
    made = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    made.update([scenes.frame(INFO, 0.1, picture(BALL), 0)], JOINTS, 0.101)
    return made


def status(snapshot, name="a"):
    return next(c for c in snapshot.cameras if c.name == name)


def spoiled(value):
    return np.full(picture().shape, value, np.float32)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e30, 0.1])
def test_images_without_a_return_are_refused(world, value):
    """The frame before stands; nothing becomes free or occupied by it."""
    before = world.update([], JOINTS, 0.11)
    snapshot = world.update([scenes.frame(INFO, 0.13, spoiled(value), 1)], JOINTS, 0.131)
    np.testing.assert_array_equal(snapshot.state, before.state)
    seen = status(snapshot)
    assert seen.stamp == 0.1
    assert seen.dropped == 1
    assert "0.00% of its pixels" in seen.reason


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -1.0])
def test_pixels_without_a_return_free_nothing(world, value):
    """Half an image without returns: there all is unknown, but what was occupied stays."""
    depth = picture(BALL)
    depth[:, :64] = value
    before = world.update([], JOINTS, 0.11)
    snapshot = world.update([scenes.frame(INFO, 0.13, depth, 1)], JOINTS, 0.131)
    lost = (before.state == FREE) & (snapshot.state != FREE)
    assert lost.sum() > 50
    assert not ((before.state != FREE) & (snapshot.state == FREE)).any()
    assert (snapshot.state == OCCUPIED)[before.state == OCCUPIED].all()
    centers = snapshot.grid.center(np.argwhere(snapshot.state == FREE))
    local = (centers - INFO.T_mount_camera[:3, 3]) @ INFO.T_mount_camera[:3, :3]
    assert INFO.depth.project(local)[:, 0].min() > 63.5


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (0.1, "the same frame again"),
        (0.05, "out of order by 0.050 s"),
        (0.3, "s in the future"),
        (np.nan, "stamp is nan"),
        (np.inf, "stamp is inf"),
        (-np.inf, "stamp is -inf"),
    ],
)
def test_stamps_that_cannot_be(world, stamp, words):
    before = world.update([], JOINTS, 0.12)
    snapshot = world.update([scenes.frame(INFO, stamp, picture(), 1)], JOINTS, 0.121)
    np.testing.assert_array_equal(snapshot.state, before.state)
    np.testing.assert_array_equal(snapshot.hazards, before.hazards)
    assert words in status(snapshot).reason
    assert status(snapshot).dropped == 1
    assert status(snapshot).alive


def test_a_stamp_slightly_ahead_of_the_clock_is_one(world):
    snapshot = world.update([scenes.frame(INFO, 0.13, picture(), 1)], JOINTS, 0.125)
    assert status(snapshot).frames == 2


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (np.zeros((5, 5), np.float32), r"(5, 5), expected (106, 128)"),
        (np.zeros((106, 128)), "float64, expected float32"),
        (np.zeros((106, 128), np.uint16), "uint16, expected float32"),
        (None, "NoneType, expected"),
    ],
)
def test_images_of_another_kind(world, depth, words):
    snapshot = world.update([scenes.frame(INFO, 0.13, depth, 1)], JOINTS, 0.131)
    assert words in status(snapshot).reason
    assert status(snapshot).dropped == 1


def test_a_refused_frame_does_not_hide_the_next_good_one(world):
    world.update([scenes.frame(INFO, 0.13, spoiled(np.nan), 1)], JOINTS, 0.131)
    snapshot = world.update([scenes.frame(INFO, 0.16, picture(), 2)], JOINTS, 0.161)
    assert status(snapshot).frames == 2
    assert status(snapshot).reason == ""


def test_of_two_frames_that_come_together_the_newer_counts(world):
    """In whatever order they lie."""
    frames = [
        scenes.frame(INFO, 0.16, picture(), 2),
        scenes.frame(INFO, 0.13, picture(BALL), 1),
    ]
    snapshot = world.update(frames, JOINTS, 0.161)
    assert status(snapshot).stamp == 0.16
    assert status(snapshot).dropped >= 1
    assert not (~snapshot.hazard_unknown).any()  # the ball has gone


def test_frames_of_a_camera_that_is_not_of_the_cell_are_left_out(world):
    other = camera("stranger", (11.3, 0.4, 0.9), 128)
    before = world.update([], JOINTS, 0.12)
    snapshot = world.update([scenes.frame(other, 0.13, picture(), 0)], JOINTS, 0.131)
    np.testing.assert_array_equal(snapshot.state, before.state)
    assert [c.name for c in snapshot.cameras] == ["a"]


def test_a_lost_frame_is_counted(world):
    snapshot = world.update([scenes.frame(INFO, 0.2, picture(), 3)], JOINTS, 0.201)
    assert status(snapshot).dropped == 2


def poses_that_cannot_be():
    """A tracked camera's, by its own word: halved, mirrored, in another frame's rows, no number."""
    T = INFO.T_mount_camera
    halved, sheared, broken = T.copy(), T.copy(), T.copy()
    halved[:3, :3] *= 0.5
    sheared[3, 0] = 0.2
    broken[1, 3] = np.nan
    return {
        "halved": halved,
        "mirrored": T @ np.diag([-1.0, 1.0, 1.0, 1.0]),
        "sheared": sheared,
        "nan": broken,
        "rows": T[:3],
        "words": np.full((4, 4), "x"),
        "nothing": np.zeros((4, 4)),
    }


@pytest.mark.parametrize("which", poses_that_cannot_be())
@pytest.mark.parametrize("by_frame", [True, False])
def test_a_picture_from_a_place_that_cannot_be_frees_nothing(world, which, by_frame):
    before = world.update([], JOINTS, 0.12)
    frame = scenes.frame(INFO, 0.13, picture(), 1)
    T = poses_that_cannot_be()[which]
    if by_frame:
        frame = replace(frame, T_base_camera=T)
    else:
        world._infos = (replace(INFO, T_mount_camera=T),)
    snapshot = world.update([frame], JOINTS, 0.131)
    np.testing.assert_array_equal(snapshot.state, before.state)
    assert status(snapshot).reason == "its camera's pose is no rotation and translation"
    assert status(snapshot).dropped == 1
    world._infos = (INFO,)
    good = replace(scenes.frame(INFO, 0.16, picture(BALL), 2))
    if by_frame:  # rounded, and narrow, as a recording may have it
        T = INFO.T_mount_camera.round(4).astype(np.float32)
        good = replace(good, T_base_camera=T)
    assert status(world.update([good], JOINTS, 0.161)).reason == ""


@pytest.mark.parametrize("now", [np.nan, np.inf, -np.inf])
def test_a_clock_that_says_no_number_leaves_no_camera_alive_and_all_else_as_it_was(world, now):
    before = world.update([], JOINTS, 0.12)
    odd = world.update([scenes.frame(INFO, 0.13, picture(), 1)], JOINTS, now)
    np.testing.assert_array_equal(odd.state, before.state)
    assert not status(odd).alive
    assert f"the clock says {now}" in status(odd).reason
    snapshot = world.update([scenes.frame(INFO, 0.16, picture(BALL), 2)], JOINTS, 0.161)
    assert status(snapshot).alive
    np.testing.assert_array_equal(snapshot.state == FREE, before.state == FREE)
    fresh = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    with pytest.raises(UsageError, match="clock says"):
        fresh.update([], JOINTS, now)


def test_a_camera_may_come_back_from_its_calibration_with_another_lens(world):
    """Its old pictures do not fit the new one, and would be read beyond their ends."""
    small = replace(camera("a", (11.3, 0.4, 0.9), 64))
    world.place(small)
    snapshot = world.update([scenes.frame(INFO, 0.13, picture(), 1)], JOINTS, 0.131)
    assert "expected (53, 64)" in status(snapshot).reason
    depth = picture(BALL, info=small)
    snapshot = world.update([scenes.frame(small, 0.16, depth, 2)], JOINTS, 0.161)
    assert status(snapshot).alive
    assert (snapshot.state == FREE).any()


@pytest.mark.parametrize("joints", ["none", "old", "nan", "nan velocity", "three"])
def test_without_joints_at_its_exposure_a_frame_is_of_no_use(joints):
    """The arm could be anywhere in it."""
    history = JointHistory()
    if joints == "old":
        history.add(JointState(0.01, np.zeros(2), np.zeros(2)))
    if joints == "nan":
        history.add(JointState(0.1, np.array([0.0, np.nan]), np.zeros(2)))
    if joints == "nan velocity":
        for stamp in (0.09, 0.11):
            history.add(JointState(stamp, np.zeros(2), np.array([0.0, np.nan])))
    if joints == "three":
        history.add(JointState(0.1, np.zeros(3), np.zeros(3)))
    made = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    snapshot = made.update([scenes.frame(INFO, 0.1, picture(), 0)], history, 0.101)
    assert "no joint reading at its exposure" in status(snapshot).reason
    assert not (snapshot.state == FREE).any()


def test_a_camera_that_dies_and_returns(world):
    """Its free space dies with it, what it saw occupied does not; both come back with it."""
    alive = world.update([], JOINTS, 0.12)
    dead = world.update([], JOINTS, 0.5)
    assert not status(dead).alive
    assert "newest frame is 0.40 s old" in status(dead).reason
    assert not (dead.state == FREE).any()
    np.testing.assert_array_equal(dead.state == OCCUPIED, alive.state == OCCUPIED)
    assert len(dead.hazards[~dead.hazard_unknown]) == len(alive.hazards[~alive.hazard_unknown])
    back = world.update([scenes.frame(INFO, 0.6, picture(BALL), 9)], JOINTS, 0.601)
    assert status(back).alive
    assert status(back).reason == ""
    np.testing.assert_array_equal(back.state == FREE, alive.state == FREE)


def test_one_of_two_cameras_dies():
    other = camera("b", (10.9, -0.9, 0.8), 128)
    made = WorkspaceMap(scenes.two_link_arm(), [INFO, other], [TABLE], CONFIG)
    both = made.update(
        [
            scenes.frame(INFO, 0.1, picture(), 0),
            scenes.frame(other, 0.1, picture(info=other), 0),
        ],
        JOINTS,
        0.101,
    )
    for k in range(1, 8):
        now = 0.1 + 0.033 * k
        one = made.update([scenes.frame(INFO, now, picture(), k)], JOINTS, now + 0.001)
    assert status(one, "a").alive
    assert not status(one, "b").alive
    alone = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    single = alone.update([scenes.frame(INFO, 0.1, picture(), 0)], JOINTS, 0.101)
    np.testing.assert_array_equal(one.state == FREE, single.state == FREE)
    assert (both.state == FREE).sum() > (one.state == FREE).sum()


def test_a_clock_that_is_turned_back_leaves_no_camera_alive(world):
    """Frames from a future that is no longer to come say nothing about now."""
    snapshot = world.update([], JOINTS, 0.05)
    assert not status(snapshot).alive
    assert not (snapshot.state == FREE).any()
    assert "the clock was turned back by 0.05 s" in status(snapshot).reason


def test_the_map_recovers_from_a_clock_that_is_turned_back():
    """What was seen occupied stays until it is seen gone; what was free is seen anew."""
    world = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    late = JointHistory()
    for k in range(100):
        late.add(JointState(100.0 + 0.01 * k, np.zeros(2), np.zeros(2)))
    for k in range(3):
        frame = scenes.frame(INFO, 100.1 + 0.033 * k, picture(BALL), 500 + k)
        before = world.update([frame], late, 100.11 + 0.033 * k)
    assert status(before).alive
    back = world.update([], JOINTS, 0.05)
    assert not status(back).alive
    assert not (back.state == FREE).any()
    np.testing.assert_array_equal(back.state == OCCUPIED, before.state == OCCUPIED)
    assert np.nanmax(back.last_occupied) <= 0.05
    stale = world.update([scenes.frame(INFO, 100.2, picture(), 503)], JOINTS, 0.06)
    assert "in the future" in status(stale).reason
    assert not (stale.state == FREE).any()
    seen = world.update([scenes.frame(INFO, 0.1, picture(BALL), 0)], JOINTS, 0.101)
    assert status(seen).alive
    np.testing.assert_array_equal(seen.state == FREE, before.state == FREE)
    for k in range(1, 4):
        gone = world.update([scenes.frame(INFO, 0.1 + 0.033 * k, picture(), k)], JOINTS, 0.3)
    assert not (~gone.hazard_unknown).any()
    assert gone.sequence > before.sequence


def test_published_arrays_do_not_change(world):
    """A reader of an old snapshot sees the old one, whatever comes after."""
    first = world.update([], JOINTS, 0.12)
    names = ("state", "distance", "hazards", "hazard_unknown", "last_occupied", "cloud")
    kept = {name: getattr(first, name).copy() for name in names}
    for k in range(1, 4):
        world.update([scenes.frame(INFO, 0.1 + 0.033 * k, picture(), k)], JOINTS, 0.11 + 0.033 * k)
    for name in names:
        np.testing.assert_array_equal(getattr(first, name), kept[name])
        with pytest.raises(ValueError, match="read-only"):
            getattr(first, name)[...] = 0


def test_cameras_that_cannot_be_told_apart():
    with pytest.raises(UsageError, match="names of their own"):
        WorkspaceMap(scenes.two_link_arm(), [INFO, INFO], [], CONFIG)
    many = [replace(INFO, name=f"c{i}") for i in range(9)]
    with pytest.raises(UsageError, match="9 depth cameras"):
        WorkspaceMap(scenes.two_link_arm(), many, [], CONFIG)


def test_all_is_unknown_without_cameras():
    made = WorkspaceMap(scenes.two_link_arm(), [], [TABLE], CONFIG)
    snapshot = made.update([], JOINTS, 1.0)
    assert set(np.unique(snapshot.state)) == {UNKNOWN, OCCUPIED}
    assert snapshot.cameras == ()


def lens(**more):
    return {"depth": replace(INFO.depth, **more)}


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({"noise": DepthNoise(np.nan, 0.0, 0.0)}, "it has a noise of"),
        ({"noise": DepthNoise(-0.3, 0.0, 0.0)}, "it has a noise of"),
        ({"noise": DepthNoise(0.3, 0.0, -0.1)}, "it has a noise of"),
        ({"range": (0.3, np.inf)}, "it has a range of 0.3 to inf m"),
        ({"range": (4.5, 0.3)}, "it has a range of"),
        ({"range": (np.nan, 4.5)}, "it has a range of"),
        ({"latency": np.inf}, "its latency"),
        ({"rate": np.nan}, "its rate is nan Hz"),
        (lens(fx=-80.0), "no lens is"),
        (lens(fy=np.nan), "no lens is|its lens is"),
        (lens(cx=np.nan), "its lens is"),
        (lens(width=0), "no lens is"),
        ({"covariance": np.zeros((6, 6))}, "the covariance"),
        ({"covariance": np.full((6, 6), np.nan)}, "the covariance"),
        ({"covariance": -np.eye(6)}, "the covariance"),
        ({"covariance": np.eye(3)}, "the covariance"),
    ],
)
def test_cameras_that_cannot_be(world, broken, words):
    """With a noise of NaN all was free that a picture showed, and what was beside the arm lost."""
    odd = replace(INFO, **broken)
    with pytest.raises(UsageError, match=f"camera a: .*({words})"):
        WorkspaceMap(scenes.two_link_arm(), [odd], [TABLE], CONFIG)
    with pytest.raises(UsageError, match=words):
        world.place(odd)
    snapshot = world.update([scenes.frame(INFO, 0.13, picture(BALL), 1)], JOINTS, 0.131)
    assert status(snapshot).alive
