"""Where a person is or could be, against a plain-numpy twin fed with the published states."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes, twins
from .test_map_oracle import CONFIG, JOINTS, TABLE, camera, random_solids, record


def indices(grid, points):
    """(nx, ny, nz) truth values of the voxels of (n, 3) centres, each named once."""
    index = grid.index(points)
    assert ((index >= 0) & (index < grid.shape)).all()
    mask = np.zeros(grid.shape, bool)
    mask[tuple(index.T)] = True
    assert mask.sum() == len(points)
    return mask


def static_of(world):
    """Voxels that declared solids fill, as the map publishes them before it has seen anything."""
    return world.update([], JOINTS, 0.0).state == OCCUPIED


def compare(twin, snapshot, static, elapsed):
    """One update of the twin from the published states, and everything it says about people."""
    hazards, unseen = snapshot.hazards, snapshot.hazard_unknown
    seen = indices(snapshot.grid, hazards[~unseen])
    dynamic = (snapshot.state == OCCUPIED) & ~static
    beside = ndimage.convolve(dynamic.astype(int), np.ones((3, 3, 3), int), mode="constant") - 1
    parts = dynamic & (beside >= CONFIG.cluster)
    # Inside declared solids the states do not tell what else was seen there.
    np.testing.assert_array_equal(seen & ~static & ~near(static), parts & ~near(static) & ~static)
    twin.update(snapshot.state == FREE, seen, elapsed)
    hidden = twin.hidden()
    unknown = ~np.isin(snapshot.state, (FREE, OCCUPIED))
    np.testing.assert_array_equal(snapshot.state[unknown] == UNKNOWN, hidden[unknown])
    could = indices(snapshot.grid, hazards[unseen])
    np.testing.assert_array_equal(could & ~static, twin.outermost() & ~dynamic & ~static)


def near(mask):
    return ndimage.binary_dilation(mask, np.ones((3, 3, 3), bool))


def start(cameras, solids, speed=2.0):
    config = replace(CONFIG, person_speed=speed)
    world = WorkspaceMap(scenes.two_link_arm(), cameras, solids, config)
    static = static_of(world)
    twin = twins.PeopleTwin(world.grid, static, config)
    twin.update(np.zeros(world.grid.shape, bool), np.zeros(world.grid.shape, bool), 0.0)
    return world, static, twin


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.3, 1.0, 2.0, 5.0]), st.booleans())
def test_random_cells(seed, speed, declared):
    """Frames of changing scenes at changing intervals, cameras that die in between."""
    rng = np.random.default_rng(seed)
    cameras = [camera("a", (11.3, 0.4, 0.9)), camera("b", (10.9, -0.9, 0.8))]
    world, static, twin = start(cameras, [TABLE] if declared else [], speed)
    last = 0.0
    sequence = dict.fromkeys("ab", 0)
    for view in record(cameras, rng, 4):
        frame = scenes.frame(view.info, view.stamp, view.depth, sequence[view.info.name])
        sequence[view.info.name] += 1
        frames = [frame] if rng.random() < 0.7 else []
        now = view.stamp + 0.001 if frames else last + 0.06
        if now <= last:
            continue
        snapshot = world.update(frames, JOINTS, now)
        compare(twin, snapshot, static, now - last)
        last = now


def test_before_the_first_frame_people_may_be_anywhere():
    world, _, _ = start([camera("a", (11.3, 0.4, 0.9))], [])
    snapshot = world.update([], JOINTS, 0.2)
    assert (snapshot.state == UNKNOWN).all()
    assert not len(snapshot.hazards)  # the box as a whole is unseen: nobody stands at its border


def rendered(info, solids, stamp, sequence):
    depth = scenes.ray_cast(info.depth, info.T_mount_camera, solids)
    return scenes.frame(info, stamp, depth, sequence)


def test_everything_seen_is_a_hazard_and_what_is_seen_free_is_none():
    info = camera("a", (11.3, 0.4, 0.9), 128)
    solids = random_solids(np.random.default_rng(0))[:3]
    ball = scenes.sphere("ball", (10.3, 0.0, 0.25), 0.1)
    world, static, twin = start([info], [TABLE])
    for k, things in enumerate(([*solids, ball], solids, solids)):
        now = 0.1 + 0.05 * k
        snapshot = world.update([rendered(info, things, now, k)], JOINTS, now + 0.001)
        compare(twin, snapshot, static, 0.101 if k == 0 else 0.05)
        free = snapshot.state == FREE
        index = snapshot.grid.index(snapshot.hazards)
        assert not free[tuple(index.T)].any()
        seen = (~snapshot.hazard_unknown).sum()
        assert seen > 10 if k == 0 else seen == 0


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_the_check_notices_dropped_hazards(share):
    info = camera("a", (11.3, 0.4, 0.9), 128)
    ball = scenes.sphere("ball", (10.3, 0.0, 0.25), 0.1)
    world, static, twin = start([info], [TABLE])
    frame = rendered(info, [*random_solids(np.random.default_rng(0))[:3], ball], 0.1, 0)
    snapshot = world.update([frame], JOINTS, 0.101)
    rng = np.random.default_rng(0)
    count = len(snapshot.hazards)
    kept = np.sort(rng.choice(count, count - max(int(share * count), 1), replace=False))
    mutant = replace(
        snapshot, hazards=snapshot.hazards[kept], hazard_unknown=snapshot.hazard_unknown[kept]
    )
    with pytest.raises(AssertionError):
        compare(twin, mutant, static, 0.101)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_people_come_from_where_the_coarse_layer_has_them(axis, side):
    """Unseen space on one side of the fine grid; three steps later they are three voxels in."""
    coarse = VoxelGrid(np.zeros(3), 0.06, (14, 15, 16))
    fine = VoxelGrid(np.full(3, 0.3), 0.02, (12, 15, 18))  # coarse cells 5 to 9, 10 and 11
    around = UnseenPeople(coarse, np.zeros(coarse.shape, np.uint8), 2.0, 0.08)
    people = UnseenPeople(fine, np.zeros(fine.shape, np.uint8), 2.0, 0.08, around)
    nothing = np.zeros(0, np.int32)
    outer, inner = np.full(coarse.shape, FREE, np.uint8), np.full(fine.shape, FREE, np.uint8)
    around.update(outer, nothing, None, 0.0)
    people.update(inner, nothing, None, 0.0)
    assert not people.mask().any()
    beyond = 5 + fine.shape[axis] // 3
    np.moveaxis(outer, axis, 0)[slice(beyond, None) if side > 0 else slice(0, 5)] = UNKNOWN
    around.update(outer, nothing, None, 9.0)
    people.update(np.full(fine.shape, UNKNOWN, np.uint8), nothing, None, 0.031)
    layers = np.moveaxis(people.mask(), axis, 0)[::-side]
    assert layers[:3].all()
    assert not layers[3:].any()
