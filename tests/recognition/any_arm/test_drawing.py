"""Drawings of arms over pictures, against OpenCV's lens."""

import cv2
import numpy as np

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import look_at
from armsight.recognition.any_arm.drawing import draw_placed
from armsight.robots import load_robot

TINT = (255, 170, 0)
Q = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])


def outline(lens: PinholeCamera) -> np.ndarray:
    """(n, 2) pixels of the outline that is drawn of an arm in a picture's corner [px]."""
    T_base_camera = look_at((1.6, 0.7, 0.4), (0.3, 0.3, 0.0), (0.0, 0.0, 1.0))
    picture = np.zeros((lens.height, lens.width, 3), np.uint8)
    drawing = draw_placed(picture, lens, load_robot("ur5"), Q, T_base_camera, True)
    row, column = np.nonzero((drawing == TINT).all(axis=2))
    return np.stack([column, row], 1).astype(float)


def test_an_outline_bends_with_the_lens():
    ideal = PinholeCamera(640, 480, 420.0, 420.0, 320.0, 240.0)
    bending = PinholeCamera(640, 480, 420.0, 420.0, 320.0, 240.0, (-0.25, 0.04, 0.001, -0.002, 0.0))
    straight, bent = outline(ideal), outline(bending)
    back = cv2.undistortPoints(
        bent[:, None], bending.K, np.array(bending.distortion), None, None, bending.K
    )[:, 0]
    inside = ((back > 8) & (back < np.array([632.0, 472.0]))).all(axis=1)
    assert inside.sum() > 300

    def nearest(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points[:, None] - straight[None], axis=2).min(axis=1)

    assert np.quantile(nearest(back[inside]), 0.98) < 3.0
    assert np.quantile(nearest(bent[inside]), 0.9) > 6.0  # it does bend there
