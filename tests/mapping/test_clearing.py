"""What is seen gone goes within two frames; what is not wholly seen through stays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.mapping.kernels.body import MIDDLE
from armsight.mapping.occupancy import FORGET, Occupancy, Sight
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.mapping.static_geometry import rasterise
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes, twins
from .test_bad_frames import BALL, INFO, TABLE, picture
from .test_map_oracle import CONFIG, JOINTS, camera

OTHER = camera("b", (10.9, -0.9, 0.8), 128)
PERIOD = 1 / 30


def rays_through(grid, voxel, info):
    """(h, w) whether each pixel's ray meets a voxel."""
    low = twins.corners_of(grid, np.array([voxel]))[0, 0]
    R, origin = info.T_mount_camera[:3, :3], info.T_mount_camera[:3, 3]
    rays = np.concatenate([info.depth.rays, np.ones((*info.depth.rays.shape[:2], 1))], -1) @ R.T
    with np.errstate(divide="ignore"):
        a, b = (low - origin) / rays, (low + grid.voxel - origin) / rays
    return np.minimum(a, b).max(-1) < np.maximum(a, b).min(-1)


def behind(depth, info, value=3.0):
    """The picture of nothing: everything far away."""
    return np.full_like(depth, value)


@pytest.mark.parametrize(("cameras", "looks"), [([INFO], 2), ([INFO, OTHER], 3)])
def test_a_departed_obstacle_goes_within_two_frames(cameras, looks):
    """Whatever any camera wholly sees through is occupied no more.

    One camera needs two looks. Of two that take turns one may see through what the other alone
    had hit: that stands for ``hold``, 60 ms, so it takes a third look at 30 Hz.
    """
    world = WorkspaceMap(scenes.two_link_arm(), cameras, [TABLE], CONFIG)
    static = world.update([], JOINTS, 0.0).state == OCCUPIED
    stamp, sequence = 0.1, 0
    for things in ([BALL], [BALL], *[[]] * looks):
        for n, info in enumerate(cameras):
            now = stamp + n * PERIOD / len(cameras)
            frame = scenes.frame(info, now, picture(*things, info=info), sequence)
            snapshot = world.update([frame], JOINTS, now + 0.001)
        if things:
            was = (snapshot.state == OCCUPIED) & ~static
        stamp, sequence = stamp + PERIOD, sequence + 1
    assert was.sum() > 20
    through = np.zeros(was.shape, bool)
    for info in cameras:
        view = twins.View(info, picture(info=info), info.T_mount_camera)
        must, _ = twins.free_bounds(view, world.grid, twins.all_voxels(world.grid))
        through |= must.reshape(was.shape)
    assert (was & through).sum() > 10
    assert not (snapshot.state == OCCUPIED)[was & through].any()
    assert not (~snapshot.hazard_unknown).any()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from(["nothing", "nearer", "there"]), st.integers(1, 3))
def test_an_obstacle_is_not_cleared_while_one_ray_of_its_voxel_is_not_seen_through(
    seed, last, left
):
    """All rays through an occupied voxel but a few reach far beyond; for half a second.

    A few rays are too few to hit it anew, so once it was looked at for long enough it may be
    unknown; never free.
    """
    rng = np.random.default_rng(seed)
    world = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    static = world.update([], JOINTS, 0.0).state == OCCUPIED
    depth = picture(BALL)
    snapshot = world.update([scenes.frame(INFO, 0.1, depth, 0)], JOINTS, 0.101)
    cells = np.argwhere((snapshot.state == OCCUPIED) & ~static)
    cell = tuple(cells[rng.integers(len(cells))])
    rays = np.argwhere(rays_through(world.grid, cell, INFO))
    assert len(rays) >= 2
    kept = rays[rng.choice(len(rays), min(left, len(rays)), replace=False)]
    image = behind(depth, INFO)
    z = depth[tuple(kept.T)]
    image[tuple(kept.T)] = {"nothing": np.nan, "nearer": 0.6, "there": z}[last]
    if last == "there" and not np.isfinite(z).all():
        return
    if last == "there":  # only where the ray did end in this voxel or before it
        points = INFO.depth.deproject(depth)[tuple(kept.T)]
        T = INFO.T_mount_camera
        found = world.grid.index(points @ T[:3, :3].T + T[:3, 3])
        if not (found == cell).all(axis=1).any():
            return
    for k in range(1, 16):
        now = 0.1 + k * PERIOD
        snapshot = world.update([scenes.frame(INFO, now, image, k)], JOINTS, now + 0.001)
        if k * PERIOD < FORGET:
            assert snapshot.state[cell] == OCCUPIED
        assert snapshot.state[cell] != FREE
    for k in (16, 17):
        now = 0.1 + k * PERIOD
        gone = scenes.frame(INFO, now, behind(depth, INFO), k)
        snapshot = world.update([gone], JOINTS, now + 0.001)
    assert snapshot.state[cell] == FREE


@pytest.mark.parametrize(
    ("depth", "fills", "stays"),
    [
        (1.005, 0, False),
        (0.985, 0, True),
        (0.0, 0, True),
        (0.96, MIDDLE, False),
        (0.94, MIDDLE, True),
    ],
    ids=["past", "before", "none", "on the arm", "before the arm"],
)
def test_a_sighting_that_nobody_confirms_is_withdrawn(depth, fills, stays):
    """Right before a wall nothing is ever seen through; a stray hit there must not stay for ever.

    It does stay where the looks do not reach the voxel's middle: something may hide it. Where the
    arm fills that, they end on the arm right before it.
    """
    grid = VoxelGrid(np.array([-0.1, -0.1, 0.9]), 0.02, (10, 10, 10))
    occupancy = Occupancy(rasterise([], grid, 0.1), 1, 0.06, 0.15)
    image = np.full((60, 80), int(depth * 10_000), np.uint16)
    lens = np.array([100.0, 100.0, 39.5, 29.5])
    noise = np.array([0.001, 0.0, 0.001])
    sight = Sight(image, 10_000.0, lens, np.eye(4), 0.3, noise, (0.01, 0.0, 3.0))
    nobody = np.full(1000, fills, np.uint8)
    none = (np.empty(0, np.int32), np.empty(0, np.uint8))
    voxel = np.array([(5 * 10 + 5) * 10 + 4], np.int32)  # its middle is 0.99 m away
    occupancy.take(0, 0.0, voxel, np.ones(1, np.uint8), nobody, sight)
    for k in range(1, 15):
        occupancy.take(0, k / 30, *none, nobody, sight)
        assert len(occupancy.dynamic) == 1  # not for half a second
    for k in range(15, 20):
        occupancy.take(0, k / 30, *none, nobody, sight)
    assert len(occupancy.dynamic) == stays
    state = occupancy.state(np.ones(1, np.uint8)).reshape(-1)[voxel[0]]
    assert state == (OCCUPIED if stays else UNKNOWN)


def test_what_something_nearer_hides_stays():
    """A box steps between camera and ball: the ball's voxels stay, though not seen any more."""
    world = WorkspaceMap(scenes.two_link_arm(), [INFO], [TABLE], CONFIG)
    static = world.update([], JOINTS, 0.0).state == OCCUPIED
    first = world.update([scenes.frame(INFO, 0.1, picture(BALL), 0)], JOINTS, 0.101)
    ball = (first.state == OCCUPIED) & ~static
    toward = INFO.T_mount_camera[:3, 3] - BALL.T_frame_solid[:3, 3]
    place = BALL.T_frame_solid[:3, 3] + 0.4 * toward
    screen = scenes.sphere("screen", tuple(place), 0.2)
    for k in range(1, 20):
        now = 0.1 + k * PERIOD
        frame = scenes.frame(INFO, now, picture(screen), k)  # the ball may have gone, unseen
        snapshot = world.update([frame], JOINTS, now + 0.001)
    assert (snapshot.state == OCCUPIED)[ball].all()


def test_another_camera_does_not_clear_at_once_what_one_has_just_hit():
    """Two cameras that disagree leave it occupied for the declared time, no longer."""
    info = camera("b", (11.3, 0.4, 0.9), 128)  # sees the same, but not the ball
    world = WorkspaceMap(scenes.two_link_arm(), [INFO, info], [TABLE], CONFIG)
    static = world.update([], JOINTS, 0.0).state == OCCUPIED
    first = world.update([scenes.frame(INFO, 0.1, picture(BALL), 0)], JOINTS, 0.101)
    ball = (first.state == OCCUPIED) & ~static
    empty = np.full_like(picture(), 3.0)
    for k, stamp in enumerate((0.11, 0.1 + CONFIG.hold - 0.01)):
        snapshot = world.update([scenes.frame(info, stamp, empty, k)], JOINTS, stamp + 0.001)
        assert (snapshot.state == OCCUPIED)[ball].all()
    stamp = 0.1 + CONFIG.hold + 0.01
    snapshot = world.update([scenes.frame(info, stamp, empty, 2)], JOINTS, stamp + 0.001)
    assert not (snapshot.state == OCCUPIED)[ball].any()


def test_a_weak_sighting_needs_a_second_one_in_time():
    """Too few pixels in a voxel are no obstacle; twice within the window they are."""
    config = replace(CONFIG, strong_share=0.9)
    ball = scenes.sphere("ball", (10.3, 0.0, 0.25), 0.05)
    image = scenes.ray_cast(INFO.depth, INFO.T_mount_camera, [ball])
    image[np.isnan(image)] = 3.0
    for gap in (0.1, 0.4):
        world = WorkspaceMap(scenes.two_link_arm(), [INFO], [], config)
        view = twins.View(INFO, image, INFO.T_mount_camera)
        strong, may_strong, touched = twins.hit_bounds(view, world.grid, [], config)
        weak = touched & ~may_strong
        assert weak.sum() >= 5
        first = world.update([scenes.frame(INFO, 0.1, image, 0)], JOINTS, 0.101)
        assert not (first.state == OCCUPIED)[weak].any()
        assert (first.state == OCCUPIED)[strong].all()
        second = world.update([scenes.frame(INFO, 0.1 + gap, image, 1)], JOINTS, 0.101 + gap)
        found = (second.state == OCCUPIED)[weak]
        assert found.sum() >= 5 if gap <= config.weak_window else not found.any()


def test_an_older_picture_that_comes_later_does_not_shorten_the_hold():
    """Cameras differ in latency: what was hit last is what was exposed last."""
    grid = VoxelGrid(np.zeros(3), 0.02, (3, 3, 3))
    seen = Occupancy(rasterise([], grid, 0.1), 3, 0.06, 0.15)
    hit, strong, nothing = np.array([13], np.int32), np.ones(1, np.uint8), np.zeros(27, np.uint8)
    seen.take(0, 1.00, hit, strong, nothing)
    seen.take(1, 0.95, hit, strong, nothing)
    seen.free[2, 13] = 1
    none = np.zeros(0, np.int32), np.zeros(0, np.uint8)
    seen.take(2, 1.03, *none, nothing)
    assert seen.dynamic.tolist() == [13], "another camera waits 60 ms"
    seen.take(2, 1.06, *none, nothing)
    assert seen.dynamic.tolist() == []
