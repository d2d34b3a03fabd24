"""What the backdrop settles must be so: every such point lies on a solid or outside the map."""

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, look_at, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.backdrop import Backdrop
from armsight.mapping.kernels.pixels import VALID
from armsight.mapping.lens import DepthLens
from armsight.mapping.snapshot import VoxelGrid
from armsight.mapping.static_geometry import rasterise

NOISE = np.array([0.001, 0.0, 0.001])
TOLERANCE = (0.015, 0.003, 3.0)
RANGE = (0.4, 4.0)
GRID = VoxelGrid(np.array([-1.2, -1.2, -0.3]), 0.06, (40, 40, 25))
CAMERA = PinholeCamera(96, 80, 70.0, 70.0, 47.5, 39.5, distortion=(0.05, -0.1, 0.0, 0.0, 0.0))


def solids(rng):
    turned = from_rpy(rng.normal(size=3))
    turned[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    ball = np.eye(4)
    ball[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    return [
        Solid("table", "box", (2.0, 2.0, 0.1), np.eye(4)),
        Solid("box", "box", (0.3, 0.2, 0.4), turned),
        Solid("post", "cylinder", (0.1, 0.9, 0.0), turned),
        Solid("ball", "sphere", (0.2, 0.0, 0.0), ball),
    ]


@pytest.mark.parametrize("seed", range(4))
def test_settled_pixels_show_a_solid_or_nothing_in_the_map(seed):
    rng = np.random.default_rng(seed)
    things = solids(rng)
    lens = DepthLens(CAMERA, 4.4)
    backdrop = Backdrop(lens, RANGE, NOISE, rasterise(things, GRID, 0.05))
    T = np.ascontiguousarray(look_at(rng.uniform([-1.5, -1.5, 0.8], [1.5, 1.5, 1.6]), np.zeros(3)))
    label = np.full((80, 96), VALID, np.uint8)
    nothing = np.ones((80, 96), np.float32)
    assert backdrop.unexplained(nothing, label, T, TOLERANCE).all()  # it may be moving
    settled = 0
    for _ in range(12):
        depth = rng.uniform(*RANGE, (80, 96)).astype(np.float32)
        done = backdrop.unexplained(depth, label, T, TOLERANCE) == 0
        z = depth[done].astype(float)
        points = np.column_stack([lens.rays[done] * z[:, None], z])
        points = transform(T, points)
        distance = np.min([s.distance(points) for s in things], axis=0)
        limit = TOLERANCE[0] + TOLERANCE[1] * z + TOLERANCE[2] * (NOISE[0] + NOISE[2] * z**2)
        cell = (points - GRID.origin) / GRID.voxel
        outside = ((cell < 1e-4) | (cell > np.array(GRID.shape) - 1e-4)).any(axis=1)
        assert (outside | (distance <= limit + 1e-5)).all()
        settled += int((~outside).sum())
    assert settled > 200


def test_what_stands_before_a_wall_is_not_settled():
    wall = np.eye(4)
    wall[:3, 3] = [1.0, 0.0, 0.5]
    thing = Solid("wall", "box", (0.1, 3.0, 3.0), wall)
    lens = DepthLens(CAMERA, 4.4)
    backdrop = Backdrop(lens, RANGE, NOISE, rasterise([thing], GRID, 0.05))
    T = np.ascontiguousarray(look_at(np.array([-1.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.5])))
    label = np.full((80, 96), VALID, np.uint8)
    for depth, open_ in ((1.95, False), (1.88, True), (1.2, True)):
        image = np.full((80, 96), depth, np.float32)
        backdrop.unexplained(image, label, T, TOLERANCE)
        assert bool(backdrop.unexplained(image, label, T, TOLERANCE)[40, 48]) is open_
    label[:] = 0
    assert not backdrop.unexplained(image, label, T, TOLERANCE).any()


def test_a_camera_that_moves_has_nothing_settled():
    lens = DepthLens(CAMERA, 4.4)
    backdrop = Backdrop(lens, RANGE, NOISE, rasterise(solids(np.random.default_rng(0)), GRID, 0.05))
    label = np.full((80, 96), VALID, np.uint8)
    far = np.full((80, 96), 3.9, np.float32)
    for step in range(3):
        T = look_at(np.array([1.0, 0.01 * step, 1.0]), np.zeros(3))
        assert backdrop.unexplained(far, label, np.ascontiguousarray(T), TOLERANCE).all()
