import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.geometry.pose import exp, inverse, log, transform
from baselines import clouds


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 300), st.floats(0.01, 0.5), st.integers(0, 2**31))
def test_centroids_against_dictionary(n, voxel, seed):
    points = np.random.default_rng(seed).normal(size=(n, 3))
    cells = {}
    for p in points:
        cells.setdefault(tuple(np.floor(p / voxel).astype(int)), []).append(p)
    expected = np.array([np.mean(cells[k], axis=0) for k in sorted(cells)]).reshape(-1, 3)
    np.testing.assert_allclose(clouds.voxel_centroids(points, voxel), expected, atol=1e-12)


def test_centroids_leave_out_what_is_not_finite():
    points = np.array([[0.0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0]])
    assert clouds.voxel_centroids(points, 0.1).tolist() == [[0, 0, 0]]
    with pytest.raises(ValueError, match="voxel"):
        clouds.voxel_centroids(points, 0.0)


def test_statistical_outliers_against_brute_force():
    rng = np.random.default_rng(0)
    points = np.vstack([rng.normal(size=(400, 3)) * [0.3, 0.3, 0.001], rng.uniform(-1, 1, (8, 3))])
    kept = clouds.statistical_inliers(points, 8, 1.5)
    gap = np.linalg.norm(points[:, None] - points[None], axis=2)
    mean = np.sort(gap, axis=1)[:, 1:9].mean(axis=1)
    np.testing.assert_array_equal(kept, mean <= mean.mean() + 1.5 * mean.std())
    assert kept[:400].mean() > 0.95
    assert kept[400:].mean() < 0.5


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_points_are_no_outliers(n):
    assert clouds.statistical_inliers(np.zeros((n, 3))).all()


def test_crop():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    assert clouds.within_sphere(points, np.zeros(3), 1.0).tolist() == [True, True, False]


def corner(rng, n=6000):
    """Points on three faces of a room's corner and on a ball."""
    faces = rng.uniform(0, 1, (n, 3))
    faces[np.arange(n), rng.integers(0, 3, n)] = 0.0
    ball = rng.normal(size=(n // 4, 3))
    ball = 0.2 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + 0.5
    return np.vstack([faces, ball])


@pytest.mark.parametrize("method", ["PLANE_ICP", "GICP"])
def test_icp_finds_a_small_displacement(method):
    rng = np.random.default_rng(7)
    target = corner(rng) + rng.normal(size=(7500, 3)) * 0.001
    T = exp([0.02, -0.015, 0.01, 0.01, -0.02, 0.015])
    source = transform(inverse(T), corner(rng) + rng.normal(size=(7500, 3)) * 0.001)
    found = clouds.icp(source, target, reach=0.06, method=method)
    error = log(inverse(T) @ found.T_target_source)
    assert found.converged
    assert np.linalg.norm(error[:3]) < 0.002
    assert np.linalg.norm(error[3:]) < 0.002
    assert found.inliers > 1000


def test_icp_refuses_empty_clouds():
    with pytest.raises(ValueError, match="source"):
        clouds.icp(np.full((30, 3), np.nan), np.zeros((30, 3)))
