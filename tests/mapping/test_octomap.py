"""Our reader and writer of OctoMap's binary format, against OctoMap itself."""

from pathlib import Path

import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.errors import ArmsightError
from armsight.geometry.pose import look_at
from armsight.mapping.octomap_io import BinaryOctree, from_state, read_bt, write_bt
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from baselines.octomap_map import OctomapBaseline

DATA = Path(__file__).parents[2] / "shared" / "data" / "motion" / "octomap"
if not DATA.is_dir():
    DATA = Path(__file__).parents[3] / "shared" / "data" / "motion" / "octomap"


def random_state(seed, shape):
    rng = np.random.default_rng(seed)
    blocks = rng.integers(0, 3, [-(-n // 4) for n in shape])  # blocks of 4, so that leaves merge
    state = np.kron(blocks, np.ones((4, 4, 4), int))[: shape[0], : shape[1], : shape[2]]
    noise = rng.random(shape) < 0.1
    state[noise] = rng.integers(0, 3, noise.sum())
    return state.astype(np.uint8)


def labels_of(tree, grid):
    index = np.argwhere(np.ones(grid.shape, bool))
    got = tree.getLabels(np.ascontiguousarray(grid.center(index)))
    out = np.full(len(index), UNKNOWN, np.uint8)
    out[got == 0], out[got == 1] = FREE, OCCUPIED
    return out.reshape(grid.shape)


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 2**31),
    st.tuples(*[st.integers(1, 18)] * 3),
    st.tuples(*[st.integers(-20, 20)] * 3),
)
def test_octomap_reads_what_we_write(tmp_path_factory, seed, shape, corner):
    path = tmp_path_factory.mktemp("bt") / "map.bt"
    grid = VoxelGrid(np.array(corner) * 0.05, 0.05, shape)
    state = random_state(seed, shape)
    write_bt(path, from_state(state, grid))
    back = read_bt(path)
    np.testing.assert_array_equal(back.to_state(grid), state)
    if (state != UNKNOWN).any():
        tree = octomap.OcTree(str(path).encode())
        assert tree.getResolution() == pytest.approx(0.05)
        np.testing.assert_array_equal(labels_of(tree, grid), state)
        assert tree.calcNumNodes() == int(path.read_bytes().split(b"size ")[1].split()[0])


def test_we_read_what_octomap_writes(tmp_path):
    rng = np.random.default_rng(2)
    baseline = OctomapBaseline(voxel=0.05)
    T = look_at([1.0, 0.3, 0.8], [0, 0, 0])
    cloud = rng.uniform(-0.4, 0.4, (3000, 3))
    cloud[:, 2] += 1.2
    baseline.insert(cloud, T)
    path = tmp_path / "theirs.bt"
    baseline.write(path)
    ours = read_bt(path)
    grid = VoxelGrid(np.array([-1.5, -1.5, -1.5]), 0.05, (60, 60, 60))
    index = np.argwhere(np.ones(grid.shape, bool))
    theirs = baseline.state(grid.center(index)).reshape(grid.shape)
    np.testing.assert_array_equal(ours.to_state(grid), theirs)
    assert (theirs == OCCUPIED).sum() > 100
    assert (theirs == FREE).sum() > 1000
    some = grid.center(index[::997])
    np.testing.assert_array_equal(ours.lookup(some), baseline.state(some))


@pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data/motion/octomap")
def test_a_real_map_agrees_with_octomap():
    path = DATA / "geb079.bt"
    ours, theirs = read_bt(path), octomap.OcTree(str(path).encode())
    assert ours.resolution == pytest.approx(theirs.getResolution())
    assert len(ours.key) == theirs.getNumLeafNodes()
    rng = np.random.default_rng(0)
    pick = rng.integers(0, len(ours.key), 20000)
    inside = ours.key[pick] + rng.uniform(0.02, 0.98, (len(pick), 3)) * ours.size[pick, None]
    labels = theirs.getLabels(np.ascontiguousarray(inside * ours.resolution))
    np.testing.assert_array_equal(labels == 1, ours.occupied[pick])
    assert (labels >= 0).all()


@pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data/motion/octomap")
def test_a_real_map_survives_a_round_trip(tmp_path):
    first = read_bt(DATA / "geb079.bt")
    write_bt(tmp_path / "copy.bt", first)
    a = (DATA / "geb079.bt").read_bytes()
    b = (tmp_path / "copy.bt").read_bytes()
    assert a.split(b"data\n", 1)[1] == b.split(b"data\n", 1)[1]


def test_leaves_merge():
    grid = VoxelGrid(np.zeros(3), 0.1, (8, 8, 8))
    tree = from_state(np.full(grid.shape, FREE, np.uint8), grid)
    assert tree.size.tolist() == [8]
    np.testing.assert_allclose(tree.centers(), [[0.4, 0.4, 0.4]])


def test_empty_map(tmp_path):
    grid = VoxelGrid(np.zeros(3), 0.1, (2, 2, 2))
    write_bt(tmp_path / "e.bt", from_state(np.zeros(grid.shape, np.uint8), grid))
    assert len(read_bt(tmp_path / "e.bt").key) == 0


def test_grid_between_voxels_is_refused():
    grid = VoxelGrid(np.array([0.03, 0, 0]), 0.1, (2, 2, 2))
    with pytest.raises(ValueError, match="between voxels"):
        from_state(np.ones(grid.shape, np.uint8), grid)


GOOD = b"# Octomap OcTree binary file\nid OcTree\nsize 9\nres 0.1\ndata\n"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"hello", "no binary OctoMap"),
        (b"# Octomap OcTree binary file\nid OcTree\n", "no data"),
        (GOOD.replace(b"id OcTree", b"id ColorOcTree"), "ColorOcTree"),
        (GOOD.replace(b"res 0.1", b"res x"), "resolution"),
        (GOOD + b"\x03", "cut short"),
        (GOOD + b"\x03\x00", "cut short"),
        (GOOD + b"\x03\x00" * 40, "broken"),
    ],
)
def test_broken_files(tmp_path, data, words):
    path = tmp_path / "bad.bt"
    path.write_bytes(data)
    with pytest.raises(ArmsightError, match=words):
        read_bt(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(ArmsightError, match="cannot read"):
        read_bt(tmp_path / "none.bt")
    empty = BinaryOctree(0.1, np.zeros((0, 3), int), np.zeros(0, int), np.zeros(0, bool))
    (tmp_path / "no").touch()
    with pytest.raises(ArmsightError, match="cannot be written"):
        write_bt(tmp_path / "no" / "x.bt", empty)
