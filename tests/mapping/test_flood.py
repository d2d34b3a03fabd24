"""The bit-packed flood against scipy's labelling of connected components."""

import numpy as np
import pytest
from scipy import ndimage

from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.kernels.flood import (
    face_points,
    grow,
    open_by_cube,
    pack,
    replace_outside,
    spread,
    surface_parts,
    unpack,
    voxel_centers,
)
from armsight.mapping.snapshot import ENCLOSED, FREE, OCCUPIED, UNKNOWN, VoxelGrid


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


def packed(mask):
    bits = np.zeros((*mask.shape[:2], (mask.shape[2] + 63) // 64), np.uint64)
    pack(mask.astype(np.uint8), 0, bits)
    return bits


def unpacked(bits, shape):
    mask = np.zeros(shape, np.uint8)
    unpack(bits, 0, mask)
    return mask.astype(bool)


DEPTHS = [37, 64, 66, 128, 150]


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("share", [0.002, 0.1])
def test_growth_is_dilation_by_all_neighbours_within_the_room(depth, share):
    rng = np.random.default_rng(depth)
    shape = (13, 11, depth)
    some = rng.random(shape) < share
    some[:4] = False  # planes with nothing in them
    room = rng.random(shape) < 0.7
    bits = packed(some)
    a, b = rng.integers(0, 2**63, (2, *bits.shape)).astype(np.uint64)  # whatever was left there
    for _ in range(4):
        expected = some | (ndimage.binary_dilation(some, np.ones((3, 3, 3))) & room)
        assert grow(bits, packed(room), a, b) == (expected != some).any()
        assert (unpacked(bits, shape) == expected).all()
        some = expected
    assert not grow(packed(room), packed(room), a, b)


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("edge", [1, 2, 4])
def test_only_what_a_cube_covers_is_left(depth, edge):
    rng = np.random.default_rng(depth)
    shape = (15, 14, depth)
    some = rng.random(shape) < 0.4
    for low in rng.integers(0, 9, (9, 3)) * [1, 1, (depth - 6) // 8]:
        some[tuple(slice(n, n + 5) for n in low)] = True
    bits = packed(some)
    open_by_cube(bits, edge, depth)
    expected = ndimage.binary_opening(some, np.ones((edge, edge, edge)))
    assert (unpacked(bits, shape) == expected).all()
    assert edge == 1 or 0 < expected.sum() < some.sum()


@pytest.mark.parametrize("shape", [(7, 5, 9), (8, 8, 8), (3, 5, 70)])
def test_unknown_space_that_hides_nobody_is_enclosed(shape):
    rng = np.random.default_rng(4)
    for share in (0.02, 0.5):
        unknown = rng.random(shape) < share
        state = np.where(unknown, UNKNOWN, rng.integers(1, 4, shape)).astype(np.uint8)
        possible = rng.random(shape) < 0.5
        expected = np.where(unknown & ~possible, ENCLOSED, state)
        bits = np.zeros((shape[0] + 4, shape[1] + 4, (shape[2] + 4 + 63) // 64), np.uint64)
        pack(possible.astype(np.uint8), 2, bits)
        replace_outside(bits, 2, UNKNOWN, ENCLOSED, state)
        assert (state == expected).all()


@pytest.mark.parametrize("parts", [1, 2, 3, 5])
def test_faces_of_cells_outside_a_box(parts):
    """Every small cube that touches an open face, unless its centre lies in the box; no other."""
    rng = np.random.default_rng(parts)
    cell, shape, origin = 0.06, np.array([9, 8, 7]), np.array([-0.3, 0.1, -0.2])
    indices = rng.permutation(int(shape.prod()))[:200].astype(np.int32)
    faces = rng.integers(0, 64, len(indices)).astype(np.uint8)
    faces[:9] = 63
    lower, upper = origin + 0.17, origin + 0.3
    found = face_points(
        indices, faces, surface_parts(parts), origin, cell, shape, parts, lower, upper
    )
    expected = []
    for index, face in zip(indices, faces):
        place = np.array(np.unravel_index(index, shape))
        for cube in np.ndindex(parts, parts, parts):
            ends = [
                (cube[d] == e) << (2 * d + s) for d in range(3) for s, e in ((0, 0), (1, parts - 1))
            ]
            center = origin + place * cell + (np.array(cube) + 0.5) * (cell / parts)
            if sum(ends) & face and not ((lower <= center) & (center < upper)).all():
                expected.append(center)
    np.testing.assert_array_equal(found, np.array(expected, np.float32))
    assert len(found) > 0.2 * parts**2 * len(indices)


def test_centres_are_those_of_the_grid():
    rng = np.random.default_rng(0)
    grid = VoxelGrid(np.array([-1.3, 0.2, -0.1]), 0.02, (31, 47, 23))
    flat = rng.permutation(31 * 47 * 23)[:5000].astype(np.int32)
    index = np.stack(np.unravel_index(flat, grid.shape), axis=1)
    found = voxel_centers(flat, np.asarray(grid.shape), grid.origin, grid.voxel)
    np.testing.assert_array_equal(found, grid.center(index).astype(np.float32))


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
