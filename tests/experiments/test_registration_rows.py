"""servo-registration: its points and figures against what a camera that is moved must be off."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.experiments.calibration_sphere import _off_at, corners_of, over_table
from armsight.experiments.servo_registration import _corners, _means
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import look_at, make_pose

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
