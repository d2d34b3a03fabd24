"""The pinhole camera against OpenCV and against itself."""

import cv2
import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera

LENS = PinholeCamera(512, 424, 365.0, 366.0, 255.1, 206.7, (0.09, -0.27, 0.001, -0.002, 0.09))


def test_projection_agrees_with_opencv():
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.8, -0.6, 1.0], [0.8, 0.6, 3.0], (200, 3))
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), LENS.K, np.array(LENS.distortion)
    )
    np.testing.assert_allclose(LENS.project(points), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("camera", [LENS, PinholeCamera.from_fov(64, 48, 1.0, 0.8)])
def test_normalise_inverts_project(camera):
    v, u = np.mgrid[10 : camera.height - 10 : 9, 10 : camera.width - 10 : 9]
    pixels = np.stack([u, v], -1).reshape(-1, 2).astype(float)
    xy = camera.normalise(pixels)
    again = camera.project(np.column_stack([xy, np.ones(len(xy))]) * 1.7)
    np.testing.assert_allclose(again, pixels, atol=1e-4)


def test_deproject_lies_on_the_rays_at_depth():
    depth = np.full((LENS.height, LENS.width), 1.5, np.float32)
    depth[0, 0] = np.nan
    points = LENS.deproject(depth)
    assert points.shape == (424, 512, 3)
    assert np.isnan(points[0, 0, 2])
    np.testing.assert_allclose(points[200, 300, 2], 1.5)
    pixel = LENS.project(points[200, 300][None])
    np.testing.assert_allclose(pixel, [[300, 200]], atol=1e-3)


def test_points_behind_have_no_pixel():
    assert np.isnan(LENS.project(np.array([[0.0, 0.0, -1.0]]))).all()


def test_field_of_view_spans_the_image_edges():
    camera = PinholeCamera.from_fov(640, 480, np.radians(57), np.radians(43))
    left = camera.normalise(np.array([[-0.5, 239.5]]))[0, 0]
    assert np.degrees(np.arctan(-left)) == pytest.approx(57 / 2)
    assert camera.cx == 319.5


def test_scaling_keeps_what_the_edges_see():
    half = LENS.scaled(0.5)
    assert (half.width, half.height) == (256, 212)
    point = np.array([[0.3, -0.2, 1.4]])
    np.testing.assert_allclose(half.project(point) + 0.5, (LENS.project(point) + 0.5) * 0.5)
