"""The bit-packed flood against scipy's labelling of connected components."""

import numpy as np
import pytest
from scipy import ndimage

from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.kernels.flood import pack, spread, unpack
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid


@pytest.mark.parametrize(("share", "seed"), [(0.15, 0), (0.3, 1), (0.6, 2)])
def test_spread_fills_connected_components(share, seed):
    rng = np.random.default_rng(seed)
    within = rng.random((21, 17, 150)) < share
    seeds = within & (rng.random(within.shape) < 0.002)
    labels, _ = ndimage.label(within, np.ones((3, 3, 3)))
    expected = within & np.isin(labels, labels[seeds])
    bits, room = (np.zeros((21, 17, 3), np.uint64) for _ in range(2))
    pack(seeds.astype(np.uint8), 0, bits)
    pack(within.astype(np.uint8), 0, room)
    spread(bits, room)
    found = np.zeros(within.shape, np.uint8)
    unpack(bits, 0, found)
    assert (found.astype(bool) == expected).all()
    assert expected.sum() > seeds.sum()


def cell():
    """A free box with a pocket of unseen space in its middle, and its people set."""
    grid = VoxelGrid(np.zeros(3), 0.02, (40, 40, 40))
    state = np.full(grid.shape, FREE, np.uint8)
    state[15:25, 15:25, 15:25] = UNKNOWN
    static = np.zeros(grid.shape, np.uint8)
    return grid, state, UnseenPeople(grid, static, speed=2.0, hand=0.08)


NOTHING = np.empty(0, np.int32)


def test_a_pocket_enclosed_by_seen_space_hides_nobody():
    _grid, state, people = cell()
    people.update(state, NOTHING, None, 0.02)
    assert not people.mask()[15:25, 15:25, 15:25].any()


def test_a_pocket_is_forgotten_once_its_way_out_is_seen_free():
    """Before all cameras have looked everything is unseen; afterwards only the pocket is left."""
    grid, state, people = cell()
    people.update(np.full(grid.shape, UNKNOWN, np.uint8), NOTHING, None, 0.02)
    assert people.mask().all()
    people.update(state, NOTHING, None, 0.02)
    assert not people.mask().any()


def test_someone_comes_into_the_pocket_by_an_unseen_way_and_at_most_as_fast_as_people_move():
    _grid, state, people = cell()
    people.update(state, NOTHING, None, 0.02)
    state[:20, 17:23, 17:23] = UNKNOWN
    reached = []
    for _ in range(14):
        people.update(state, NOTHING, None, 0.02)
        reached.append(int(np.flatnonzero(people.mask().any(axis=(1, 2))).max(initial=-1)))
    assert reached[-1] == 24
    assert (np.diff(reached) <= 2).all()  # 2 m/s are 2 voxels in 20 ms


def test_a_seen_thing_may_reach_into_the_unseen_space_behind_it():
    grid, state, people = cell()
    people.update(state, NOTHING, None, 0.02)
    state[20, 20, 26] = OCCUPIED
    state[18:23, 18:23, 25] = UNKNOWN
    seen = np.ravel_multi_index(([20], [20], [26]), grid.shape).astype(np.int32)
    for _ in range(20):
        people.update(state, seen, None, 0.02)
    assert people.mask()[15:25, 15:25, 15:25].any()
