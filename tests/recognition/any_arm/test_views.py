"""Crops of a virtual camera: what lies where in the picture lies where it says in the crop."""

import cv2
import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.frames import lumps_of
from armsight.recognition.any_arm.pixel_kernels import NOWHERE, crop_map
from armsight.recognition.any_arm.views import (
    GREY,
    SIDE,
    looking_along,
    mask_in_picture,
    take_crop,
    take_whole,
)
from armsight.recognition.own_arm.kernels import lens_array

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


def test_a_map_of_a_crop_is_the_lens_own_projection() -> None:
    R = looking_along(np.array([0.5, -0.2, 1.0]))
    u, v = crop_map(R, 60.0, 40, lens_array(LENS))
    line = (np.arange(40) - 19.5) / 60.0
    x, y = np.meshgrid(line, line)
    true = LENS.project(np.stack([x.ravel(), y.ravel(), np.ones(x.size)], 1) @ R.T)
    np.testing.assert_allclose(np.stack([u.ravel(), v.ravel()], 1), true, rtol=1e-5)


def test_what_lies_behind_the_camera_is_nowhere() -> None:
    R = looking_along(np.array([1.0, 0.0, -0.2]))
    u, v = crop_map(R, 100.0, 40, lens_array(LENS))
    line = (np.arange(40) - 19.5) / 100.0
    x, y = np.meshgrid(line, line)
    behind = (np.stack([x, y, np.ones_like(x)], -1) @ R.T)[..., 2] <= 0.0
    assert behind.any()
    assert (u[behind] == NOWHERE).all()
    assert (v[behind] == NOWHERE).all()


@pytest.mark.parametrize("corner", [(0.0, 0.0), (520.0, 380.0), (-40.0, 200.0)])
def test_a_crop_of_a_part_is_the_crop_of_the_whole(corner: tuple[float, float]) -> None:
    """Only what the crop sees is shrunk; a smooth picture does not tell the difference."""
    lens = PinholeCamera(640, 480, 1500.0, 1500.0, 330.0, 235.0, (-0.12, 0.05, 0.001, -0.002, 0.0))
    v, u = np.mgrid[0:480, 0:640]
    waves = [np.sin(u / 31.0), np.cos(v / 27.0), np.sin((u + v) / 40.0)]
    image = (127 + 100 * np.stack(waves, -1)).astype(np.uint8)
    low = np.array(corner)
    crop = take_crop(image, lens, low, low + 160.0, 1.3, 64)
    seen_u, seen_v = crop_map(crop.R, crop.f, 64, lens_array(lens))
    true = cv2.remap(image, seen_u, seen_v, cv2.INTER_LINEAR, borderValue=(GREY, GREY, GREY))
    inner = cv2.erode(crop.inside.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert inner.sum() > 500
    off = np.abs(crop.image.astype(int) - true)[inner]
    assert off.max() <= 12
    assert off.mean() < 1.5
    beyond = (seen_u < -20) | (seen_v < -20) | (seen_u > 660) | (seen_v > 500)
    assert (crop.image[beyond] == GREY).all()


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


@pytest.mark.parametrize("size", [(640, 480), (1277, 719), (200, 131)])
def test_a_map_lies_where_each_of_its_pixels_says(size: tuple[int, int]) -> None:
    """Against each pixel of the picture brought into the crop by itself."""
    w, h = size
    lens = PinholeCamera(w, h, 0.8 * w, 0.8 * w, 0.51 * w, 0.49 * h, (-0.12, 0.05, 0.001, 0.0, 0.0))
    low = np.array([0.4 * w, 0.3 * h])
    crop = take_crop(np.zeros((h, w, 3), np.uint8), lens, low, low + 0.4 * h, 1.3)
    y, x = np.mgrid[:48, :48]
    arm = np.exp(-((x - 20.0) ** 2 + (y - 26.0) ** 2) / 60.0).astype(np.float32)
    v, u = np.mgrid[:h, :w]
    rays = lens.normalise(np.stack([u.ravel(), v.ravel()], 1))
    cells = (crop.pixels(np.hstack([rays, np.ones((h * w, 1))])) + 0.5) / 4 - 0.5
    a, b = cells.astype(np.float32).reshape(h, w, 2).transpose(2, 0, 1)
    true = cv2.remap(arm, a, b, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    np.testing.assert_allclose(mask_in_picture(crop, arm, lens), true, atol=0.02)


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
