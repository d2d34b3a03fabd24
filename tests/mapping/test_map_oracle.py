"""The map against its plain-numpy twins: random cells, real frames, and mutants of the map.

The cell stands 10 m from the arm, so that nothing but the scene matters here; frames say where
their camera was.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.geometry.pose import inverse, look_at
from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes, twins

CONFIG = MappingConfig(
    lower=(10.0, -0.28, 0.0),
    upper=(10.56, 0.28, 0.4),
    voxel=0.04,
    distance_cap=0.2,
    far_lower=(0, 0, 0),
    far_upper=(0, 0, 0),
    align=False,
    threads=1,
)
TABLE = scenes.box("table", (10.3, 0.0, 0.02), (0.3, 0.3, 0.06))
JOINTS = scenes.resting([0.0, 0.0], until=1.0)


def camera(name, position, width=64, **more):
    size = (width, width * 53 // 64)
    return scenes.camera_info(name, position, (10.28, 0.0, 0.2), size, **more)


def random_solids(rng):
    """Something behind everything, and a few things that come and go."""
    wall = scenes.box("wall", (8.6, 0.0, 0.0), (0.1, 6.0, 6.0))
    floor = scenes.box("floor", (10.3, 0.0, -0.3), (6.0, 6.0, 0.1))
    things = [
        scenes.sphere(
            "ball", tuple(rng.uniform([10, -0.3, 0], [10.6, 0.3, 0.4])), rng.uniform(0.04, 0.14)
        )
        for _ in range(rng.integers(1, 5))
    ]
    return [wall, floor, TABLE, *things]


def record(cameras, rng, rounds):
    """Views of a changing scene, 20 ms apart, with noise and holes."""
    views = []
    for k in range(rounds):
        solids = random_solids(rng)
        for n, info in enumerate(cameras):
            depth = scenes.ray_cast(info.depth, info.T_mount_camera, solids)
            depth = scenes.add_noise(depth, info.noise, rng, holes=0.02)
            stamp = 0.1 + 0.04 * k + 0.02 * n
            views.append(twins.View(info, depth, info.T_mount_camera, stamp))
    return views


def play(views, cameras, config=CONFIG, solids=(TABLE,)):
    """Snapshots, one a view."""
    world = WorkspaceMap(scenes.two_link_arm(), cameras, list(solids), config)
    count = dict.fromkeys((c.name for c in cameras), 0)
    for view in views:
        name = view.info.name
        frame = replace(
            scenes.frame(view.info, view.stamp, view.depth, count[name]),
            T_base_camera=view.T_base_camera,
        )
        count[name] += 1
        yield world.update([frame], JOINTS, view.stamp + 0.001)
    world.close()


def random_cell(seed):
    """Two cameras in a random cell: how many voxels end free, none of them wrongly."""
    noise = scenes.DepthNoise(0.001, 0.0, 0.001)
    cameras = [camera("a", (11.3, 0.4, 0.9), noise=noise), camera("b", (10.9, -0.9, 0.8))]
    return compare_with_twin(cameras, seed, pad=1.0)


def random_cell_through_a_distorted_lens(seed):
    bent = camera("bent", (11.2, 0.3, 0.8), distortion=(0.09, -0.27, 0.001, -0.002, 0.09))
    return compare_with_twin([bent], seed, pad=4.0)


def compare_with_twin(cameras, seed, pad):
    views = record(cameras, np.random.default_rng(seed), 3)
    grid = WorkspaceMap(scenes.two_link_arm(), cameras, [TABLE], CONFIG).grid
    twin = twins.MapTwin(grid, [TABLE], CONFIG, pad)
    for view, snapshot in zip(views, play(views, cameras)):
        twin.take(view)
        assert {k: len(v) for k, v in twin.wrong(snapshot).items() if len(v)} == {}
    return (snapshot.state == FREE).sum()


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31))
def test_random_cells(seed):
    random_cell(seed)


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 2**31))
def test_random_cells_through_a_distorted_lens(seed):
    random_cell_through_a_distorted_lens(seed)


def test_the_random_cells_are_worth_comparing():
    """Much is free in these; a random one may hide nearly everything behind a ball."""
    assert random_cell(0) > 300
    assert random_cell_through_a_distorted_lens(0) > 200


@pytest.fixture(scope="module")
def cell():
    """A cell of 2 cm voxels seen by two cameras, its twin, and the map's last snapshot."""
    config = replace(CONFIG, voxel=0.02)
    cameras = [camera("a", (11.3, 0.4, 0.9), 128), camera("b", (10.9, -0.9, 0.8), 128)]
    things = [TABLE, scenes.sphere("ball", (10.3, -0.05, 0.25), 0.1)]
    things.append(scenes.box("wall", (8.6, 0.0, 0.0), (0.1, 6.0, 6.0)))
    views = [
        twins.View(c, scenes.ray_cast(c.depth, c.T_mount_camera, things), c.T_mount_camera, stamp)
        for c, stamp in zip(cameras, (0.1, 0.12))
    ]
    *_, snapshot = play(views, cameras, config)
    twin = twins.MapTwin(snapshot.grid, [TABLE], config)
    for view in views:
        twin.take(view)
    assert not any(len(v) for v in twin.wrong(snapshot).values())
    return twin, snapshot


def mutant(snapshot, where, state):
    changed = snapshot.state.copy()
    changed.reshape(-1)[where] = state
    return replace(snapshot, state=changed)


@pytest.mark.parametrize(
    ("lost", "put"), [(OCCUPIED, FREE), (OCCUPIED, UNKNOWN), (FREE, UNKNOWN), (UNKNOWN, FREE)]
)
@pytest.mark.parametrize("seed", range(5))
def test_the_check_notices_a_hundredth_of_changed_voxels(cell, lost, put, seed):
    """Occupied voxels dropped or called free, free ones forgotten, unseen ones called free."""
    twin, snapshot = cell
    here = np.flatnonzero(snapshot.state == lost)
    share = np.random.default_rng(seed).choice(here, max(len(here) // 100, 3), replace=False)
    assert any(len(v) for v in twin.wrong(mutant(snapshot, share, put)).values())


def test_the_check_notices_invented_obstacles(cell):
    twin, snapshot = cell
    free = np.flatnonzero((snapshot.state == FREE) & ~twin.may)
    assert len(twin.wrong(mutant(snapshot, free[::100], OCCUPIED))["occupied"]) == len(free[::100])


def kitchen(folder, count):
    """Real depth frames and where the camera was, the first one placed beside the grid."""
    cv2 = pytest.importorskip("cv2")
    frames = sorted((folder / "rgbd-frames").glob("*.depth.png"))[::5][:count]
    first = None
    for path in frames:
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000.0
        pose = np.loadtxt(str(path).replace(".depth.png", ".pose.txt"))
        if first is None:
            first = look_at([12.0, 0.0, 0.6], [10.3, 0.0, 0.2]) @ inverse(pose)
        yield np.where(depth > 0, depth, np.float32(np.nan)), first @ pose


def test_real_frames(shared_data):
    """Kinect frames of a kitchen: holes, edges, a moving camera."""
    folder = shared_data / "motion" / "depth_kitchen"
    if not folder.is_dir():
        pytest.skip("no depth_kitchen in ../shared/data")
    lens = scenes.PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
    info = replace(
        camera("kinect", (12.0, 0.0, 0.6), noise=scenes.DepthNoise(0.001, 0.0, 0.002)),
        depth=lens,
    )
    config = replace(CONFIG, lower=(10.0, -0.4, -0.2), upper=(10.8, 0.4, 0.6))
    views = [
        twins.View(info, depth, T, 0.1 + 0.033 * k)
        for k, (depth, T) in enumerate(kitchen(folder, 4))
    ]
    twin = None
    for view, snapshot in zip(views, play(views, [info], config, ())):
        twin = twin or twins.MapTwin(snapshot.grid, [], config)
        twin.take(view)
        wrong = {k: len(v) for k, v in twin.wrong(snapshot).items()}
        assert not any(wrong.values()), wrong
    assert twin.must.sum() > 50
    assert (snapshot.state == FREE).sum() > 1000
