"""The converging pair."""

import numpy as np

from armsight.devices.camera_models import stereo_pair
from armsight.geometry.pose import inverse, transform


def test_triangulation_undoes_projection() -> None:
    pair = stereo_pair()
    p = np.random.default_rng(0).uniform([-0.3, -0.3, 0.5], [0.3, 0.3, 2.5], (50, 3))
    left = pair.left.project(p)
    right = pair.right.project(transform(inverse(pair.T_left_right), p))
    assert np.allclose(pair.triangulate(left, right), p, atol=1e-6)


def test_equation_1_holds_on_the_axis() -> None:
    """Z0 = b / tan(toe-in) is where the axes cross; there equation 1 is exact."""
    pair = stereo_pair(baseline=0.2, toe_in=float(np.arctan(0.2 / 1.0)))
    left = np.array([[pair.left.cx, pair.left.cy]])
    right = np.array([[pair.right.cx, pair.right.cy]])
    assert np.allclose(pair.triangulate(left, right), [[0, 0, 1.0]], atol=1e-9)
    assert np.allclose(pair.triangulate_converging(left, right), [[0, 0, 1.0]], atol=1e-9)


def test_a_pair_is_what_was_asked_for() -> None:
    pair = stereo_pair(baseline=0.06, toe_in=0.1, focal=900.0)
    assert np.isclose(pair.baseline, 0.06)
    assert np.isclose(pair.toe_in, 0.1)
    assert pair.left.fx == pair.right.fy == 900.0
