"""A camera at rest goes by a plan: the same voxels as by the search itself, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import look_at
from armsight.mapping import carving
from armsight.mapping.carving import Carver
from armsight.mapping.lens import DepthLens
from armsight.mapping.snapshot import VoxelGrid

NOISE = np.array([1.5e-3, -0.5e-3, 0.6e-3])
GRIDS = {
    "odd": VoxelGrid(np.array([-0.41, -0.37, 0.0]), 0.02, (43, 37, 26)),
    "coarse": VoxelGrid(np.array([-1.2, -1.2, -0.1]), 0.06, (41, 40, 19)),
    "one voxel": VoxelGrid(np.array([-0.1, -0.1, 0.3]), 0.3, (1, 1, 1)),
}
EYES = {
    "across": ([1.1, 0.7, 1.2], [0.0, 0.0, 0.2]),
    "above": ([0.01, 0.0, 2.1], [0.0, 0.0, 0.0]),
    "inside": ([0.1, -0.2, 0.3], [0.4, 0.3, 0.1]),
    "away": ([1.0, 0.0, 1.0], [3.0, 0.0, 1.0]),
}


def picture(lens: PinholeCamera, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Patches of depth with noise, and pixels without a return."""
    h, w = lens.height, lens.width
    depth = np.kron(rng.uniform(0.2, 3.0, (h // 8 + 1, w // 8 + 1)), np.ones((8, 8)))[:h, :w]
    depth = (depth + 0.003 * rng.standard_normal((h, w))).astype(np.float32)
    return depth, (rng.random((h, w)) > 0.01).astype(np.uint8)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("distortion", [(0.0,) * 5, (0.08, -0.2, 0.0, 0.0, 0.08)])
def test_the_plan_frees_what_the_search_frees(
    grid: str, eye: str, distortion: tuple[float, ...]
) -> None:
    voxels = GRIDS[grid]
    camera = PinholeCamera(160, 120, 130.0, 131.0, 79.2, 60.7, distortion)
    lens = DepthLens(camera, 4.0)
    T = look_at(*EYES[eye])
    planned = Carver(lens, voxels, 0.3, NOISE)
    found = np.empty(int(np.prod(voxels.shape)), np.uint8)
    expected = np.empty_like(found)
    freed = 0
    for k in range(6):
        lens.tabulate(*picture(camera, np.random.default_rng(k)))
        planned.carve(T, found)
        Carver(lens, voxels, 0.3, NOISE).carve(T, expected)  # has seen one frame only: no plan
        np.testing.assert_array_equal(found, expected)
        freed += int(found.sum())
    assert planned.planned
    if eye == "across" and grid != "one voxel":
        assert freed > 100


def test_a_camera_that_moves_is_not_planned_and_one_that_was_moved_is_planned_anew() -> None:
    grid = GRIDS["odd"]
    camera = PinholeCamera(160, 120, 130.0, 131.0, 79.2, 60.7)
    lens = DepthLens(camera, 4.0)
    lens.tabulate(*picture(camera, np.random.default_rng(0)))
    carver = Carver(lens, grid, 0.3, NOISE)
    found = np.empty(int(np.prod(grid.shape)), np.uint8)
    expected = np.empty_like(found)
    places = [[1.0, 0.1 * k, 1.0] for k in range(3)]
    for place in places:
        carver.carve(look_at(place, [0, 0, 0.2]), found)
        assert not carver.planned
    carver.carve(look_at(places[-1], [0, 0, 0.2]), found)
    assert carver.planned
    carver.carve(look_at(places[0], [0, 0, 0.2]), found)
    assert not carver.planned
    Carver(lens, grid, 0.3, NOISE).carve(look_at(places[0], [0, 0, 0.2]), expected)
    np.testing.assert_array_equal(found, expected)


def test_large_pictures_of_voxels_are_planned_and_large_grids_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera = PinholeCamera(640, 480, 3000.0, 3000.0, 319.5, 239.5)  # 8 cm are 160 pixels
    lens = DepthLens(camera, 4.0)
    depth = np.full((480, 640), 3.0, np.float32)
    depth[:, 300:] = 1.5
    lens.tabulate(depth, np.ones(depth.shape, np.uint8))
    grid = VoxelGrid(np.array([-0.2, -0.2, -0.2]), 0.02, (20, 20, 20))
    T = look_at([0.0, 1.5, 0.0], [0.0, 0.0, 0.0])
    found = np.empty(8000, np.uint8)
    expected = np.empty_like(found)
    carver = Carver(lens, grid, 0.3, NOISE)
    for out in (expected, found, found):
        carver.carve(T, out)
    np.testing.assert_array_equal(found, expected)
    assert carver.planned
    assert 0 < found.sum() < found.size

    monkeypatch.setattr(carving, "MOST_PLANNED", 7999)
    small = Carver(lens, grid, 0.3, NOISE)
    for out in (expected, found):
        small.carve(T, out)
    assert not small.planned
    np.testing.assert_array_equal(found, expected)


def test_a_grid_as_high_as_a_plan_can_count_is_freed_alike() -> None:
    grid = VoxelGrid(np.array([-0.03, -0.03, 0.0]), 0.005, (11, 12, 511))
    camera = PinholeCamera(160, 120, 50.0, 50.0, 79.2, 60.7)
    lens = DepthLens(camera, 9.0)
    depth = np.full((120, 160), 6.0, np.float32)
    depth[::13] = 2.5
    lens.tabulate(depth, np.ones(depth.shape, np.uint8))
    found = np.empty(int(np.prod(grid.shape)), np.uint8)
    expected = np.empty_like(found)
    carver = Carver(lens, grid, 0.3, NOISE)
    for out in (expected, found, found):
        carver.carve(look_at([3.0, 0.2, 1.2], [0.0, 0.0, 1.2]), out)
    assert carver.planned
    np.testing.assert_array_equal(found, expected)
    assert 0.1 < found.mean() < 0.9


@pytest.mark.parametrize("size", [(37, 61), (5, 3), (9, 130)])
def test_tables_hold_the_least_of_windows_and_the_nearness_of_squares(
    size: tuple[int, int],
) -> None:
    h, w = size  # some pictures are smaller than the windows
    camera = PinholeCamera(w, h, 40.0, 40.0, 0.5 * w, 0.5 * h)
    lens = DepthLens(camera, 4.0)
    depth = np.random.default_rng(3).uniform(0.2, 4.0, size).astype(np.float32)
    lens.tabulate(depth, np.ones(size, np.uint8))
    image = lens.least[0]
    np.testing.assert_allclose(image / lens.units, depth, atol=1.01 / lens.units)
    squares = 65535 - np.array(
        [[image[v : v + 8, u : u + 8].max() for u in range(0, w, 8)] for v in range(0, h, 8)]
    )
    for table, first in ((lens.least, image), (lens.nearness, squares)):
        for level in range(len(table)):
            side = 1 << level
            rows, columns = (np.arange(n) for n in first.shape)
            expected = [[first[v : v + side, u : u + side].min() for u in columns] for v in rows]
            np.testing.assert_array_equal(table[level], expected)
