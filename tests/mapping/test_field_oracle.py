"""The distance field against brute force: a lower bound, tight, and the same however it came about.

Stated (``docs/mapping.md``): for every voxel the exact distance between its cube and the nearest
solid cube, capped, to float32 accuracy and never above it.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from armsight.mapping.config import MappingConfig
from armsight.mapping.distance_field import DistanceField, bounded_distance
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes, twins
from .test_map_oracle import CONFIG, JOINTS, camera, kitchen, play, random_solids, record

shapes = st.tuples(*[st.integers(1, 14)] * 3)
seeds = st.integers(0, 2**31)


def solid_of(snapshot, config):
    """What the field is the distance to; unseen space that nobody can be in is not solid."""
    if config.unknown_is_solid:
        return (snapshot.state == OCCUPIED) | (snapshot.state == UNKNOWN)
    return snapshot.state == OCCUPIED


@settings(max_examples=40, deadline=None)
@given(seeds, shapes, st.sampled_from([0.0, 0.002, 0.02, 0.3, 1.0]), st.sampled_from([2, 5, 15]))
def test_field_of_random_grids(seed, shape, share, cap):
    solid = np.random.default_rng(seed).random(shape) < share
    field = bounded_distance(solid, 0.02, cap * 0.02)
    assert field.dtype == np.float32
    assert not len(twins.wrong_field(field, solid, 0.02, cap * 0.02))


def test_field_of_a_large_grid():
    """scipy's transform of the solid set grown by one voxel is the same distance."""
    rng = np.random.default_rng(1)
    solid = rng.random((90, 75, 80)) < 0.0005
    grown = np.zeros_like(solid)
    padded = np.pad(solid, 1)
    for i, j, k in itertools.product(range(3), repeat=3):
        grown |= padded[i : i + 90, j : j + 75, k : k + 80]
    true = np.minimum(0.02 * distance_transform_edt(~grown), 0.3)
    field = bounded_distance(solid, 0.02, 0.3)
    assert (field <= true).all()
    np.testing.assert_allclose(field, true, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_bound_of_any_point_of_the_voxel(seed):
    """Never larger than the distance from any point to any solid cube, a diagonal smaller at most.

    The points are random and the voxel's corners; the distance is to the nearest cubes' surfaces.
    """
    rng = np.random.default_rng(seed)
    voxel, cap, shape = 0.02, 0.2, (12, 11, 10)
    solid = rng.random(shape) < 0.01
    field = bounded_distance(solid, voxel, cap)
    cells = np.argwhere(solid)
    at = rng.integers(0, shape, (400, 3))
    inside = np.concatenate([rng.random((300, 3)), rng.integers(0, 2, (100, 3))])
    points = (at + inside) * voxel
    low = cells * voxel
    gap = np.maximum(np.maximum(low[None] - points[:, None], points[:, None] - low - voxel), 0)
    true = np.sqrt((gap**2).sum(-1)).min(axis=1) if len(cells) else np.full(400, np.inf)
    found = field[tuple(at.T)]
    assert (found <= true + 1e-9).all()
    assert (found >= np.minimum(true, cap) - np.sqrt(3) * voxel - 1e-6).all()


@settings(max_examples=20, deadline=None)
@given(seeds, shapes, st.booleans())
def test_any_sequence_of_updates_equals_a_fresh_field(seed, shape, unknown):
    rng = np.random.default_rng(seed)
    state = np.full(shape, FREE, np.uint8)
    field = DistanceField(shape, 0.02, 0.1, unknown)
    before = None
    for _ in range(8):
        kind = rng.integers(4)
        if kind == 0:  # a few voxels change
            where = rng.random(shape) < 0.01
            state[where] = rng.integers(0, 3, where.sum())
        elif kind == 1:  # a box appears or goes
            a, b = np.sort(rng.integers(0, np.asarray(shape) + 1, (2, 3)), axis=0)
            state[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = rng.choice([FREE, OCCUPIED, UNKNOWN])
        elif kind == 2:  # everything goes
            state[:] = FREE
        distance = field.update(state.copy())
        solid = (state == OCCUPIED) | ((state == UNKNOWN) & unknown)
        assert not len(twins.wrong_field(distance, solid, 0.02, 0.1))
        if before is not None:  # what was handed out does not change any more
            np.testing.assert_array_equal(*before)
        before = (distance, distance.copy())
        assert not distance.flags.writeable


@pytest.mark.parametrize("unknown", [False, True])
def test_field_of_snapshots_through_a_changing_scene(unknown):
    config = replace(CONFIG, unknown_is_solid=unknown)
    rng = np.random.default_rng(3)
    cameras = [camera("a", (11.3, 0.4, 0.9)), camera("b", (10.9, -0.9, 0.8))]
    for snapshot in play(record(cameras, rng, 6), cameras, config):
        solid = solid_of(snapshot, config)
        wrong = twins.wrong_field(snapshot.distance, solid, config.voxel, snapshot.distance_cap)
        assert not len(wrong)
        assert snapshot.distance_counts_unknown == unknown


def test_field_of_real_frames(shared_data):
    folder = shared_data / "motion" / "depth_kitchen"
    if not folder.is_dir():
        pytest.skip("no depth_kitchen in ../shared/data")
    lens = scenes.PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
    info = replace(camera("kinect", (12.0, 0.0, 0.6)), depth=lens)
    config = MappingConfig(
        lower=(9.6, -0.8, -0.4),
        upper=(11.0, 0.8, 0.8),
        align=False,
        far_lower=(0, 0, 0),
        far_upper=(0, 0, 0),
    )
    views = [
        twins.View(info, depth, T, 0.1 + 0.033 * k)
        for k, (depth, T) in enumerate(kitchen(folder, 5))
    ]
    rng = np.random.default_rng(0)
    for snapshot in play(views, [info], config, ()):
        cells = np.argwhere(snapshot.state == OCCUPIED)
        at = rng.integers(0, snapshot.grid.shape, (20_000, 3))
        # Nearest cubes by brute force among the candidates a tree finds by their centres.
        reach = 0.3 / 0.02 + 2 * np.sqrt(3)
        near = cKDTree(cells).query_ball_point(at[:2000], reach)
        true = [
            0.02 * np.sqrt((np.maximum(np.abs(cells[n] - a) - 1, 0) ** 2).sum(1).min())
            if n
            else np.inf
            for n, a in zip(near, at)
        ]
        found = snapshot.distance[tuple(at[:2000].T)]
        true = np.minimum(true, 0.3)
        assert (found <= true).all()
        np.testing.assert_allclose(found, true, atol=1e-6)
    assert len(cells) > 1000


@pytest.fixture(scope="module")
def before_and_after():
    """Two snapshots of a cell, a ball moved between them."""
    info = camera("a", (11.3, 0.4, 0.9), 128)
    config = replace(CONFIG, voxel=0.02)
    views = []
    for stamp, y in ((0.1, -0.1), (0.14, 0.0), (0.18, 0.08)):
        ball = scenes.sphere("ball", (10.3, y, 0.25), 0.08)
        things = [*random_solids(np.random.default_rng(0))[:3], ball]
        depth = scenes.ray_cast(info.depth, info.T_mount_camera, things)
        views.append(twins.View(info, depth, info.T_mount_camera, stamp))
    return list(play(views, [info], config)), config


@pytest.mark.parametrize("seed", range(3))
def test_the_check_notices_a_hundredth_of_dropped_voxels(seed):
    """A field computed from 99 % of the occupied voxels, in a room of thinly strewn ones.

    In a closed surface a single voxel less changes no distance at all, as its neighbours' cubes
    touch its own; there ``test_map_oracle`` notices by the states.
    """
    rng = np.random.default_rng(seed)
    solid = rng.random((30, 30, 30)) < 0.012
    cells = np.flatnonzero(solid)
    lost = rng.choice(cells, len(cells) // 100, replace=False)
    fewer = solid.copy()
    fewer.reshape(-1)[lost] = False
    assert not len(twins.wrong_field(bounded_distance(solid, 0.02, 0.2), solid, 0.02, 0.2))
    assert len(twins.wrong_field(bounded_distance(fewer, 0.02, 0.2), solid, 0.02, 0.2)) > 30


@pytest.mark.parametrize("seed", range(3))
def test_the_check_notices_a_hundredth_of_dropped_updates(before_and_after, seed):
    """A field in which one changed voxel in a hundred keeps its distance of before."""
    (*_, first, last), config = before_and_after
    changed = np.flatnonzero(first.distance != last.distance)
    assert len(changed) > 1000
    kept = np.random.default_rng(seed).choice(changed, len(changed) // 100, replace=False)
    field = last.distance.copy()
    field.reshape(-1)[kept] = first.distance.reshape(-1)[kept]
    solid = last.state == OCCUPIED
    wrong = twins.wrong_field(field, solid, config.voxel, last.distance_cap)
    assert set(kept) == set(wrong)


def test_an_empty_map_is_far_from_everything():
    world = WorkspaceMap(scenes.two_link_arm(), [camera("a", (11.3, 0.4, 0.9))], [], CONFIG)
    snapshot = world.update([], JOINTS, 0.0)
    np.testing.assert_allclose(snapshot.distance, snapshot.distance_cap, atol=1e-6)
    assert (snapshot.distance <= snapshot.distance_cap).all()
