"""From a picture's camera to the network's and back."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from armsight.calibration.export import camera_info_yaml
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.inference.intrinsics import (
    camera_for,
    check_camera,
    parse_intrinsics,
    project,
    read_camera,
    view_through,
)
from armsight.recognition.inference.resample import fit, fit_box, fit_K

from .conftest import K as NETWORK_K

K_NETWORK = np.array(NETWORK_K)


@pytest.mark.parametrize("size", [(640, 480), (512, 424), (300, 900), (100, 90), (64, 53)])
def test_a_spot_lands_where_the_matrix_says(size: tuple[int, int]) -> None:
    columns, rows = size
    left, top, w, h = fit_box(columns, rows, 64, 53)
    assert left >= 0
    assert top >= 0
    assert left + w <= columns
    assert top + h <= rows
    assert abs(w / h - 64 / 53) < 64 / 53 * 0.02
    spot = np.array([left + 0.3 * w, top + 0.6 * h])
    v, u = np.mgrid[0:rows, 0:columns]
    near = np.exp(-((u - spot[0]) ** 2 + (v - spot[1]) ** 2) / (2 * (w / 20) ** 2))
    small = fit((255 * near).astype(np.uint8), 64, 53).astype(float)
    y, x = np.mgrid[0:53, 0:64]
    found = [(small * x).sum() / small.sum(), (small * y).sum() / small.sum()]
    expected = fit_K(np.eye(3), columns, rows, 64, 53) @ [*spot, 1.0]
    np.testing.assert_allclose(found, expected[:2], atol=0.1)


def spot_at(camera: PinholeCamera, point: np.ndarray) -> np.ndarray:
    pixel = project(point[None], camera.K, np.array(camera.distortion))[0]
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    size = camera.fx / 24
    near = np.exp(-((u - pixel[0]) ** 2 + (v - pixel[1]) ** 2) / (2 * size**2))
    return np.repeat((255 * near).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize(
    "camera",
    [
        PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0),
        PinholeCamera(1280, 720, 1500.0, 1480.0, 600.0, 380.0),
        PinholeCamera(320, 240, 150.0, 150.0, 160.0, 119.0),
        PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0, (-0.2, 0.05, 0.001, -0.001, 0.0)),
    ],
)
def test_any_lens_shows_the_network_its_own_rays(camera: PinholeCamera) -> None:
    point = np.array([0.12, -0.1, 1.6])
    view = view_through(spot_at(camera, point), camera, K_NETWORK, 64, 53)
    assert view.given
    image = view.image[..., 0].astype(float)
    y, x = np.mgrid[0:53, 0:64]
    found = [(image * x).sum() / image.sum(), (image * y).sum() / image.sum()]
    expected = (K_NETWORK @ point / point[2])[:2]
    np.testing.assert_allclose(found, expected, atol=0.25)


def test_a_narrow_picture_covers_a_part(tmp_path: Path) -> None:
    narrow = PinholeCamera(640, 480, 2000.0, 2000.0, 320.0, 240.0)
    image = np.full((480, 640, 3), 200, np.uint8)
    view = view_through(image, narrow, K_NETWORK, 64, 53)
    assert 0.02 < view.covered < 0.2
    assert (view.image == 0).mean() > 0.7


def test_without_a_camera_the_networks_is_assumed() -> None:
    image = np.zeros((530, 640, 3), np.uint8)
    view = view_through(image, None, K_NETWORK, 64, 53)
    assert not view.given
    np.testing.assert_allclose(view.K[:2, :2], 10 * K_NETWORK[:2, :2])
    np.testing.assert_allclose(view.K[:2, 2], 10 * (K_NETWORK[:2, 2] + 0.5) - 0.5)


def test_points_behind_the_camera_have_no_pixel() -> None:
    found = project(np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 0]]), K_NETWORK, np.zeros(5))
    np.testing.assert_allclose(found[0], K_NETWORK[:2, 2])
    assert np.isnan(found[1:]).all()


def test_ros_files_come_back(tmp_path: Path) -> None:
    camera = PinholeCamera(640, 480, 500.0, 510.0, 320.0, 240.0, (-0.2, 0.05, 0.001, -0.001, 0.01))
    (tmp_path / "a.yaml").write_text(camera_info_yaml("a", camera))
    assert read_camera(tmp_path / "a.yaml") == camera


def camera_info(width: str, number: str) -> str:
    return (
        f"image_width: {width}\nimage_height: 480\n"
        f"camera_matrix: {{data: [500, 0, 320, 0, 500, 240, 0, 0, {number}]}}"
    )


@pytest.mark.parametrize(
    "text",
    ["", "a: [", "[1, 2]", "image_width: 640", "!!python/object/apply:os.system ['true']", "\xff",
     "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [1, 2]}",
     camera_info("640", "1" + 400 * "0"), camera_info("1" + 400 * "0", "1"),
     camera_info(".inf", "1"), camera_info(".nan", "1"), camera_info("1e300", "1")],
)  # fmt: skip
def test_broken_camera_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.yaml").write_text(text, encoding="latin-1")
    with pytest.raises(RecognitionError, match=r"a\.yaml"):
        read_camera(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    "words", ["", "1,2,3", "a,b,c,d", "0.5,0.5,320,240", "500,500,5000,240", "nan,1,1,1",
              "1e9,1e9,320,240", "500,-500,320,240", "500,500,0,0"],
)  # fmt: skip
def test_intrinsics_that_no_camera_has(words: str) -> None:
    with pytest.raises(RecognitionError, match="--intrinsics"):
        parse_intrinsics(words, 640, 480)


def test_scaled_pictures_get_scaled_cameras() -> None:
    camera = PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5)
    half = camera_for(camera, 320, 240, "it")
    assert (half.fx, half.cx, half.cy) == (250.0, 159.5, 119.5)
    check_camera(half, "it")
    with pytest.raises(RecognitionError, match="another camera"):
        camera_for(camera, 640, 360, "it")


def test_project_is_opencvs() -> None:
    point = np.array([[0.3, -0.2, 1.1]])
    bent = np.array([-0.1, 0.01, 0.0, 0.0, 0.0])
    expected, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), K_NETWORK, bent)
    np.testing.assert_allclose(project(point, K_NETWORK, bent), expected[0])


@pytest.mark.parametrize("orientation", [6, 8])
def test_a_camera_of_lying_pictures_serves_those_that_were_turned(orientation: int) -> None:
    lying = PinholeCamera(640, 480, 500.0, 510.0, 330.0, 225.0, (-0.1, 0.02, 0.003, -0.002, 0.01))
    upright = camera_for(lying, 480, 640, "it", orientation)
    points = np.array([[0.3, -0.2, 1.1], [-0.25, 0.1, 0.9], [0.0, 0.05, 2.0]])
    u, v = lying.project(points).T
    if orientation == 6:  # clockwise: what was the left edge is the upper one
        turned, expected = np.stack([-points[:, 1], points[:, 0]], 1), np.stack([479 - v, u], 1)
    else:
        turned, expected = np.stack([points[:, 1], -points[:, 0]], 1), np.stack([v, 639 - u], 1)
    found = upright.project(np.hstack([turned, points[:, 2:]]))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    half = camera_for(lying, 240, 320, "it", orientation)
    assert (half.width, half.height, half.fx) == (240, 320, 255.0)


def test_a_picture_on_its_side_is_not_said_to_be_cut() -> None:
    camera = PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5)
    with pytest.raises(RecognitionError, match="lies on its side"):
        camera_for(camera, 480, 640, "it")
    upright = PinholeCamera(480, 640, 500.0, 500.0, 239.5, 319.5)
    assert camera_for(upright, 480, 640, "it", 6) == upright
