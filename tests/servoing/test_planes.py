"""What the pair sees in depth, drawn to be looked at."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from armsight.servoing.eyes import beside
from armsight.servoing.planes import FAR, NEAR, PLANES, depth_picture

from .test_ball import COLOR
from .traced import pair

SPACING = (FAR - NEAR) / (PLANES - 1)


def wall(depth, texture):
    """A pair before a printed wall, square to the left lens, so far away [m]."""
    view = pair([(np.array([0.0, 0.0, 0.3]), 0.04, COLOR)], np.eye(4), np.random.default_rng(0))
    left, right = view.info.left, view.info.right
    v, u = np.mgrid[0 : right.height, 0 : right.width]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    T = view.info.T_left_right
    rays = np.column_stack([right.normalise(pixels), np.ones(len(pixels))]) @ T[:3, :3].T
    along = (depth - T[2, 3]) / rays[:, 2]
    at = left.project(rays * along[:, None] + T[:3, 3]).astype(np.float32)
    seen = cv2.remap(texture, *at.reshape(*u.shape, 2).transpose(2, 0, 1), cv2.INTER_LINEAR)
    return replace(view, frame=replace(view.frame, left=texture, right=seen))


def shade(depth):
    """The colour of a depth, from OpenCV's own table."""
    level = np.array([[round(255.0 * (FAR - depth) / (FAR - NEAR))]], np.uint8)
    return cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[0, 0, ::-1].astype(int)


@pytest.mark.parametrize("depth", [0.22, 0.28, 0.37])
def test_a_printed_wall_has_the_colour_of_its_depth(depth):
    rng = np.random.default_rng(1)
    texture = cv2.resize(rng.integers(0, 255, (24, 36, 3)).astype(np.uint8), (720, 480))
    drawn = depth_picture(wall(depth, texture))
    planes = NEAR + SPACING * np.arange(PLANES)
    right = [shade(d) for d in planes[np.abs(planes - depth) < SPACING]]
    h, w = drawn.shape[:2]
    middle = drawn[h // 3 : -h // 3, w // 3 : -w // 3].astype(int)
    fits = np.any([np.abs(middle - c).max(axis=-1) <= 3 for c in right], axis=0)
    assert fits.mean() > 0.95


def test_where_nothing_tells_places_apart_nothing_is_said():
    drawn = depth_picture(wall(0.3, np.full((480, 720, 3), 128, np.uint8)))
    assert drawn[20:60, 20:90].max() < 60


def test_pictures_of_any_size_stand_beside_each_other():
    row = beside([np.zeros((240, 360, 3), np.uint8), np.full((80, 120, 3), 7, np.uint8)])
    assert row.shape == (240, 720, 3)
    assert (row[:, 360:] == 7).all()
