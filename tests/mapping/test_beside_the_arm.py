"""Which pixels beside the arm's outline are trusted: against the rule in plain words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.devices.data import DepthNoise
from armsight.geometry.pose import transform
from armsight.mapping.config import MappingConfig
from armsight.mapping.kernels.pixels import NOTHING, ROBOT, VALID, trusted
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes

LIKE, EXACT, NEED = 0.05, 0.03, 3


def by_the_words(depth, label, v, u):
    """The rule of :func:`trusted`, pixel by pixel."""
    h, w = depth.shape
    z = depth[v, u]

    def pixels(reach):
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if (dy or dx) and 0 <= v + dy < h and 0 <= u + dx < w:
                    yield dy, dx, depth[v + dy, u + dx], label[v + dy, u + dx]

    beside = [d for _, _, d, _ in pixels(1)]
    mixed = any(z - d > LIKE for d in beside)
    alike = [what for _, _, d, what in pixels(1) if abs(d - z) <= LIKE]
    if sum(not (mixed and what == ROBOT) for what in alike) < NEED:
        return False
    if any(d - z > LIKE for d in beside) and any(z - d > LIKE for d in beside):
        return False
    for dy, dx, d, what in pixels(2):
        if what != ROBOT or d >= z:
            continue
        if max(abs(dy), abs(dx)) == 1:
            y, x = v - 2 * dy, u - 2 * dx
            if not (0 <= y < h and 0 <= x < w):
                return False
            if label[y, x] != VALID or label[v - dy, u - dx] != VALID:
                return False
            if abs(2.0 * depth[v - dy, u - dx] - depth[y, x] - z) > EXACT:
                return False
            continue
        y, x = v + np.clip(dy, -1, 1), u + np.clip(dx, -1, 1)
        if label[y, x] == ROBOT and depth[y, x] < z:
            continue
        if label[y, x] != VALID or abs(depth[y, x] - z) > LIKE:
            return False
    return True


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_against_the_words(seed):
    rng = np.random.default_rng(seed)
    depth = (1.0 + 0.04 * rng.integers(-2, 3, (7, 8)) * (rng.random() < 0.7)).astype(np.float32)
    label = rng.choice([VALID, ROBOT, NOTHING], (7, 8), p=[0.8, 0.15, 0.05]).astype(np.uint8)
    depth[label == ROBOT] -= np.float32(rng.choice([0.0, 0.03, 0.3]))
    depth[label == NOTHING] = np.nan
    for v in range(7):
        for u in range(8):
            if label[v, u] == VALID:
                found = trusted(depth, label, v, u, LIKE, EXACT, NEED)
                assert found == by_the_words(depth, label, v, u)


def column(values):
    """A picture of which every row holds these depths; the first two columns show the arm."""
    depth = np.tile(np.asarray(values, np.float32), (9, 1))
    label = np.full(depth.shape, VALID, np.uint8)
    label[:, :2] = ROBOT
    return depth, label


def judged(values):
    """Which pixels of the middle row are trusted, from the third on."""
    depth, label = column(values)
    return [trusted(depth, label, 4, u, LIKE, EXACT, NEED) for u in range(2, 6)]


def before_the_arm(*rows):
    """A picture of the arm (R, at 1.5 m) behind something nearer (N), and what is said between."""
    depth, label = np.full((9, 9), 1.5, np.float32), np.full((9, 9), ROBOT, np.uint8)
    depth[:, 5:], label[:, 5:] = 1.0, VALID
    for v, row in enumerate(rows):
        for u, value in enumerate(row):
            if value is not None:
                depth[3 + v, 3 + u], label[3 + v, 3 + u] = value, VALID
    return lambda v, u: trusted(depth, label, 3 + v, 3 + u, LIKE, EXACT, NEED)


def test_a_mixture_of_the_arm_and_of_what_is_before_it_is_not_trusted():
    """It is of a depth like the arm's, which bears no witness for it."""
    seen = before_the_arm((None, 1.47), (None, 1.2), (None, 1.46))
    assert not any(seen(v, 1) for v in range(3))


def test_a_fingertip_that_comes_from_behind_something_before_the_arm_is_trusted():
    """Four pixels of it bear witness for each other."""
    seen = before_the_arm((1.46, 1.46), (1.46, 1.46))
    assert all(seen(v, u) for v in range(2) for u in range(2))
    alone = before_the_arm((1.46, None), (None, None))
    assert alone(0, 0), "nothing nearer is beside it: it is no mixture"


def test_the_border_of_a_post_before_the_arm_leaves_nothing_in_the_map():
    """A single voxel beside an arm holds it: in a trial of the servoing cell for 3.5 s."""
    noise = DepthNoise(1.5e-3, -0.5e-3, 0.3e-3)
    info = scenes.camera_info("a", (1.5, 1.05, 1.4), size=(512, 424), noise=noise, rate=15.0)
    robot, q = scenes.two_link_arm(), np.array([-0.6, -0.3])
    declared = [
        scenes.box("table", (0, 0, -0.05), (4.0, 4.0, 0.1)),
        scenes.box("post", (0.6, 0.3, 0.5), (0.1, 0.1, 1.0)),
    ]
    depth = scenes.ray_cast(
        info.depth, info.T_mount_camera, [*declared, *scenes.arm_solids(robot, q)]
    )
    aligned = {"calibration_m": 0.003, "calibration_rad": 0.002}
    config = MappingConfig((-0.8, -0.8, -0.1), (0.8, 0.8, 0.9), align=False, **aligned)
    world, rng = WorkspaceMap(robot, [info], declared, config), np.random.default_rng(0)
    found = 0
    for k in range(36):
        stamp = 0.1 + k / 15
        frame = scenes.frame(info, stamp, scenes.with_borders(depth, noise, rng), k)
        snapshot = world.update([frame], scenes.resting(q, until=3.0), stamp + 0.005)
        solid = snapshot.grid.center(np.argwhere(snapshot.state == OCCUPIED))
        away = np.min([thing.distance(solid) for thing in declared], axis=0)
        found += int((away > snapshot.grid.voxel).sum())
    assert found == 0


@pytest.mark.parametrize(("size", "seen"), [(1, False), (2, True)])
def test_a_mixture_of_one_declared_solid_and_another_leaves_nothing_and_a_fingertip_is_seen(
    size, seen
):
    """Of the depth of the wall behind, which bears no witness for it at the post's border."""
    info = scenes.camera_info("a", (1.5, 0.0, 0.4), (0.0, 0.0, 0.4), size=(256, 212))
    robot, q = scenes.two_link_arm(), np.array([2.0, 0.0])
    wall = scenes.box("wall", (-0.65, 0.0, 0.4), (0.1, 3.0, 3.0))
    post = scenes.box("post", (0.3, 0.1, 0.4), (0.1, 0.1, 0.6))
    solids = [wall, post, *scenes.arm_solids(robot, q)]
    depth = scenes.ray_cast(info.depth, info.T_mount_camera, solids)
    v, u = 75, int(np.flatnonzero(np.diff(depth[75]) < -0.5)[0])  # of the wall, the post beside
    behind = depth[v, u]
    assert behind - depth[v, u + 1] > 0.5
    like = 0.01 + 0.01 * behind
    depth[v : v + size, u + 1 - size : u + 1] -= np.float32(0.9 * like)
    point = np.array([*info.depth.rays[v, u], 1.0]) * depth[v, u]
    # A mixture is nearer than the wall by more than the wall explains, by less than is alike.
    config = MappingConfig(
        (-0.8, -0.8, -0.1), (0.8, 0.8, 0.9), align=False, calibration_m=0.0, calibration_rad=0.0
    )
    assert config.static_margin < 0.9 * like
    world, found = WorkspaceMap(robot, [info], [wall, post], config), 0
    for k in range(4):
        frame = scenes.frame(info, 0.1 + k / 15, depth, k)
        snapshot = world.update([frame], scenes.resting(q, until=1.0), 0.105 + k / 15)
        at = tuple(snapshot.grid.index(transform(info.T_mount_camera, point[None]))[0])
        found += snapshot.state[at] == OCCUPIED
    world.close()
    assert (found > 0) == seen


def test_a_surface_behind_the_outline_is_seen_up_to_it():
    assert judged([0.9, 0.9, 1.5, 1.5, 1.5, 1.5, 1.5]) == [True] * 4
    assert judged([0.9, 0.9, 1.42, 1.44, 1.46, 1.48, 1.5]) == [True] * 4


def test_a_mixture_of_arm_and_wall_is_not_trusted_nor_its_neighbour():
    assert judged([0.9, 0.9, 1.2, 1.5, 1.5, 1.5, 1.5]) == [False, False, True, True]
    assert judged([0.9, 0.9, 1.46, 1.5, 1.5, 1.5, 1.5]) == [False, True, True, True]


def test_beside_an_outline_without_returns_nothing_is_trusted():
    depth, label = column([0.9, 0.9, np.nan, 1.2, 1.5, 1.5, 1.5])
    label[:, 2] = NOTHING
    assert not trusted(depth, label, 4, 3, LIKE, EXACT, NEED)


@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, -np.inf, np.nan])
def test_a_finger_with_a_ragged_outline_is_trusted_however_it_is_said(value):
    """Three pixels wide before a wall; beside it every second pixel has no return."""
    depth = np.full((9, 9), 2.0, np.float32)
    depth[:, 3:6] = 1.0
    label = np.full(depth.shape, VALID, np.uint8)
    for column in (2, 6):
        depth[1::2, column], label[1::2, column] = value, NOTHING
    assert all(trusted(depth, label, 4, u, LIKE, EXACT, NEED) for u in (3, 4, 5))


@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, -np.inf])
def test_whatever_says_that_there_is_no_return_says_the_same(value):
    rng = np.random.default_rng(3)
    for _ in range(30):
        depth = (1.0 + 0.5 * rng.integers(0, 2, (9, 9))).astype(np.float32)
        label = rng.choice([VALID, ROBOT, NOTHING], depth.shape, p=[0.7, 0.1, 0.2]).astype(np.uint8)
        told = []
        for hole in (np.nan, value):
            depth[label == NOTHING] = hole
            pixels = np.argwhere(label == VALID)
            told.append([trusted(depth, label, v, u, LIKE, EXACT, NEED) for v, u in pixels])
        assert told[0] == told[1]
        assert 0 < sum(told[0]) < len(told[0])
