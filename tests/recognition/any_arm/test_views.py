"""Crops of a virtual camera: what lies where in the picture lies where it says in the crop."""

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.frames import lumps_of
from armsight.recognition.any_arm.views import SIDE, mask_in_picture, take_crop, take_whole

LENS = PinholeCamera(640, 480, 520.0, 520.0, 330.0, 235.0, (-0.12, 0.05, 0.001, -0.002, 0.0))


def _spotted(points: np.ndarray) -> np.ndarray:
    image = np.zeros((480, 640, 3), np.uint8)
    v, u = np.mgrid[0:480, 0:640]
    for x, y in LENS.project(points):
        image[(u - x) ** 2 + (v - y) ** 2 < 5.0**2] = 255
    return image


@pytest.mark.parametrize("low", [(60.0, 40.0), (400.0, 300.0)])
def test_a_point_of_the_scene_is_where_the_crop_says(low: tuple[float, float]) -> None:
    box = np.array(low), np.array(low) + np.array([160.0, 110.0])
    middle = LENS.normalise(np.array([0.5 * (box[0] + box[1])]))[0]
    point = 1.7 * np.array([[*middle, 1.0]])
    crop = take_crop(_spotted(point), LENS, *box, 1.3)
    bright = np.argwhere(crop.image[..., 0] > 127)
    assert len(bright) > 5
    np.testing.assert_allclose(bright.mean(axis=0)[::-1], crop.pixels(point)[0], atol=0.6)
    rays = crop.rays(crop.pixels(point))
    seen = np.array([*rays[0], 1.0]) @ crop.R.T
    np.testing.assert_allclose(seen / seen[2], point[0] / point[0, 2], atol=1e-9)


def test_the_box_fills_its_share_of_the_crop() -> None:
    low, high = np.array([200.0, 120.0]), np.array([420.0, 360.0])
    crop = take_crop(np.zeros((480, 640, 3), np.uint8), LENS, low, high, 1.25)
    u, v = np.meshgrid(np.linspace(low[0], high[0], 9), np.linspace(low[1], high[1], 9))
    rays = LENS.normalise(np.stack([u.ravel(), v.ravel()], 1))
    inside = crop.pixels(np.hstack([rays, np.ones((81, 1))]))
    assert inside.min() > 0.0
    assert inside.max() < SIDE - 1
    assert np.ptp(inside, axis=0).max() == pytest.approx(SIDE / 1.25, rel=0.06)


def test_a_mask_comes_back_to_its_place() -> None:
    low, high = np.array([300.0, 150.0]), np.array([500.0, 330.0])
    image = np.zeros((480, 640, 3), np.uint8)
    image[180:300, 340:460] = 255
    crop = take_crop(image, LENS, low, high, 1.3)
    arm = (
        crop.image[..., 0].reshape(SIDE // 4, 4, SIDE // 4, 4).mean((1, 3)).astype(np.float32) / 255
    )
    back = mask_in_picture(crop, arm, LENS) > 0.5
    true = image[..., 0] > 0
    assert (back & true).sum() / (back | true).sum() > 0.9


def test_lumps_are_found_in_the_pictures_own_pixels() -> None:
    whole = take_whole(np.zeros((480, 640, 3), np.uint8))
    assert whole.image.shape == (192, 256, 3)
    arm = np.zeros((48, 64), np.float32)
    arm[10:20, 5:12] = 0.9
    arm[21:24, 6:9] = 0.8  # beyond a thin thing that stands before it
    arm[30:40, 40:60] = 0.7
    arm[2, 60] = 0.9  # a speck
    first, second = lumps_of(arm, whole)
    np.testing.assert_allclose([first.low, first.high], [[400, 300], [600, 400]])
    np.testing.assert_allclose([second.low, second.high], [[50, 100], [120, 240]])
    assert lumps_of(np.full((48, 64), 0.2, np.float32), whole) == []
