import numpy as np
import pytest
import trimesh

from armsight.errors import ArmsightError
from armsight.geometry import cloud


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
        (b"ply\nformat\nelement vertex 1\nend_header\n1", "broken"),
        (b"ply\nformat ascii 1.0\nelement vertex one\nend_header\n1", "broken PLY file.*one"),
        (b"ply\nformat ascii 1.0\nelement vertex\nend_header\n1", "broken"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float\nend_header\n1", "broken"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\na", "broken"),
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
