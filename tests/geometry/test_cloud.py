import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.errors import ArmsightError
from armsight.geometry import cloud


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 300), st.floats(0.01, 0.5), st.integers(0, 2**31))
def test_centroids_against_dictionary(n, voxel, seed):
    points = np.random.default_rng(seed).normal(size=(n, 3))
    cells = {}
    for p in points:
        cells.setdefault(tuple(np.floor(p / voxel).astype(int)), []).append(p)
    expected = np.array([np.mean(cells[k], axis=0) for k in sorted(cells)]).reshape(-1, 3)
    np.testing.assert_allclose(cloud.voxel_centroids(points, voxel), expected, atol=1e-12)


def test_centroids_leave_out_what_is_not_finite():
    points = np.array([[0.0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0]])
    assert cloud.voxel_centroids(points, 0.1).tolist() == [[0, 0, 0]]
    with pytest.raises(ValueError, match="voxel"):
        cloud.voxel_centroids(points, 0.0)


def test_statistical_outliers_against_brute_force():
    rng = np.random.default_rng(0)
    points = np.vstack([rng.normal(size=(400, 3)) * [0.3, 0.3, 0.001], rng.uniform(-1, 1, (8, 3))])
    kept = cloud.statistical_inliers(points, 8, 1.5)
    gap = np.linalg.norm(points[:, None] - points[None], axis=2)
    mean = np.sort(gap, axis=1)[:, 1:9].mean(axis=1)
    np.testing.assert_array_equal(kept, mean <= mean.mean() + 1.5 * mean.std())
    assert kept[:400].mean() > 0.95
    assert kept[400:].mean() < 0.5


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_points_are_no_outliers(n):
    assert cloud.statistical_inliers(np.zeros((n, 3))).all()


def test_crops():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    assert cloud.within_sphere(points, np.zeros(3), 1.0).tolist() == [True, True, False]
    assert cloud.within_box(points, -np.ones(3), np.ones(3)).tolist() == [True, True, False]


def test_merge():
    assert cloud.merge([]).shape == (0, 3)
    joined = cloud.merge([np.zeros((2, 3)), np.full((3, 3), 0.01)], voxel=0.1)
    np.testing.assert_allclose(joined, [[0.006] * 3])


def test_ply_is_read_by_trimesh_and_back(tmp_path):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    colors = rng.integers(0, 256, (50, 3)).astype(np.uint8)
    path = tmp_path / "cloud.ply"
    cloud.write_ply(path, points, colors)
    other = trimesh.load(path)
    np.testing.assert_allclose(other.vertices, points, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(other.visual.vertex_colors)[:, :3], colors)
    back, back_colors = cloud.read_ply(path)
    np.testing.assert_array_equal(back, points)
    np.testing.assert_array_equal(back_colors, colors)
    assert list(tmp_path.iterdir()) == [path]


def test_ply_text_and_no_color(tmp_path):
    path = tmp_path / "text.ply"
    path.write_bytes(
        b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\n1 2 3\n4 5 6\n"
    )
    points, colors = cloud.read_ply(path)
    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert colors is None


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"no", "no PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1", "cut short"),
        (b"ply\nformat ascii 1.0\nelement face 2\nend_header\n1", "vertices first"),
        (b"ply\nformat odd 1.0\nelement vertex 0\nend_header\n", "understood"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1", "without x"),
    ],
)
def test_bad_ply(tmp_path, data, words):
    path = tmp_path / "bad.ply"
    path.write_bytes(data)
    with pytest.raises(ArmsightError, match=words):
        cloud.read_ply(path)


def test_file_in_the_way_and_missing_file(tmp_path):
    (tmp_path / "no").touch()
    with pytest.raises(ArmsightError, match="cannot be written"):
        cloud.write_ply(tmp_path / "no" / "x.ply", np.zeros((1, 3)))
    with pytest.raises(ArmsightError, match="cannot read"):
        cloud.read_ply(tmp_path / "none.ply")
