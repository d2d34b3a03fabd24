"""A lens from frames of a board alone: against the lens that drew them; refusals say the cause."""

import cv2
import numpy as np
import pytest

from armsight.calibration.lens import calibrate_lens
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera

LENS = PinholeCamera(640, 480, 600.0, 600.0, 319.5, 239.5)
GRID = 0.03 * np.stack(np.meshgrid(np.arange(7), np.arange(5), indexing="ij"), -1).reshape(-1, 2)
BOARD = np.c_[GRID, np.zeros(len(GRID))]


def frames(count=8, tilt=0.6, seed=0):
    """All corners of a board in some poses, to 0.2 px."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):
        R = cv2.Rodrigues(rng.uniform(-tilt, tilt, 3))[0]
        t = rng.uniform((-0.15, -0.1, 0.4), (0.05, 0.05, 0.8))
        pixels = LENS.project(BOARD @ R.T + t) + rng.normal(0, 0.2, GRID.shape)
        out.append((np.arange(len(BOARD)), pixels))
    return out


def nonsense(seed=1):
    return np.arange(len(BOARD)), np.random.default_rng(seed).uniform(0, 480, GRID.shape)


@pytest.mark.parametrize("wrong", [0, 5])
def test_a_lens_is_found_though_some_frames_are_of_no_board(wrong):
    seen = frames(8) + [nonsense(k) for k in range(wrong)]
    found = calibrate_lens(BOARD, seen, 640, 480)
    assert abs(found.camera.fx - LENS.fx) < 5.0


def test_a_lens_is_found_though_one_corner_in_ten_is_wrong():
    rng, seen = np.random.default_rng(3), []
    for corner, pixel in frames(10):
        bad = rng.random(len(corner)) < 0.1
        seen.append((corner, np.where(bad[:, None], rng.uniform(0, 480, pixel.shape), pixel)))
    found = calibrate_lens(BOARD, seen, 640, 480)
    assert abs(found.camera.fx - LENS.fx) < 12.0


@pytest.mark.parametrize("sheet", [None, LENS])
@pytest.mark.parametrize("count", [0, 1, 3, 5])  # five of them are on one line
def test_frames_that_show_too_little_are_not_said_to_be_frontal(sheet, count):
    seen = [(corner[:count], pixel[:count]) for corner, pixel in frames()]
    with pytest.raises(CalibrationError, match="none of the 8 frames has four corners"):
        calibrate_lens(BOARD, seen, 640, 480, sheet)


@pytest.mark.parametrize(
    ("sheet", "says"),
    [(None, "in 8 of 8 frames the corners do not lie"), (LENS, "in no frame do the corners lie")],
)
def test_frames_of_no_board_are_said_to_be_none(sheet, says):
    with pytest.raises(CalibrationError, match=says):
        calibrate_lens(
            BOARD, [(np.arange(len(BOARD)), np.full(GRID.shape, 99.0))] * 8, 640, 480, sheet
        )


def test_frontal_frames_are_said_to_be_frontal():
    with pytest.raises(CalibrationError, match="facing the camera; tilt it"):
        calibrate_lens(BOARD, frames(tilt=0.0, seed=1), 640, 480)
