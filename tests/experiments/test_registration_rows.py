"""servo-registration: its points and figures against what a camera that is moved must be off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.experiments.calibration_sphere import _off_at, corners_of, over_table
from armsight.experiments.servo_registration import _corners, _means
from armsight.experiments.wrist_registration import as_built, errors
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import look_at, make_pose
from armsight.workcell import open_cell
from armsight.workcell.build import simulated_world
from armsight.workcell.packaged import load

LENS = PinholeCamera.from_fov(512, 424, 1.2, 1.05)
LOWER, UPPER = np.array([-0.8, -1.0, 0.7]), np.array([1.4, 1.0, 1.9])


def test_a_camera_that_is_moved_is_off_by_that_wherever_it_looks():
    T = look_at((1.7, 1.4, 2.0), (0.3, 0.0, 1.0))
    moved = make_pose(None, (0.003, -0.004, 0.0)) @ T
    points = np.concatenate([over_table(LOWER, UPPER), corners_of(LOWER, UPPER)])
    assert (points[:, 2] <= 0.7 + 0.5 + 1e-9).all()
    believed = SimpleNamespace(depth=LENS)
    off = _off_at(believed, moved, SimpleNamespace(unit=SimpleNamespace(depth=LENS)), T, points)
    seen = [o for o in off if o is not None]
    assert 10 < len(seen) < len(points), "some lie beside what it sees"
    assert seen == pytest.approx([0.005] * len(seen), abs=1e-6)


def test_the_worst_corner_is_that_of_its_cameras_mean():
    done = [
        {
            "cameras": [
                {"table": [0.002, None, 0.004], "corners": [0.001, None, 0.009, 0.002]},
                {"table": [0.006], "corners": [0.003, None, 0.001, None]},
            ]
        }
    ]
    assert _means(done) == [pytest.approx(4.0)]
    assert _corners(done) == [pytest.approx(5.0)]


def test_a_point_through_a_pair_that_is_as_believed_is_where_it_is():
    """And through one whose mount is 3 mm off by 3 mm, wherever the arm stands."""
    workcell = load("ur10_servoing")
    with open_cell(workcell, 3, calibrated=False) as cell:
        world = simulated_world(cell)
        (pair,) = world.stereo_cameras
        exact = replace(pair.unit, depth=pair.info.left, color=pair.info.right)
        exact = replace(exact, T_depth_color=pair.info.T_left_right)
        pair.unit = exact
        T = pair.T_mount_camera
        told = SimpleNamespace(spec=world.spec, arm=SimpleNamespace(compliance=0.0))
        told._cell = world._cell
        for off in (0.0, 0.003):
            moved = T @ make_pose(None, (0.0, off, 0.0))
            rng = np.random.default_rng(0)
            found = errors(cell.robot, cell.robot, told, pair, moved, rng)
            assert found == pytest.approx(off, abs=1e-6)
        built = as_built(cell.robot, world, 3)
        found = errors(cell.robot, built, world, pair, T, np.random.default_rng(0))
        assert 0.0002 < found.mean() < 0.004
