"""A look with the calibrated arm drawn over it: its surface as a cloud, and the frames.

After the charging paper's figure 8: where calibration is right the cloud lies on the arm and the
plug's frame in its mouth.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, JointVector, Mask, Points, Pose
from armsight.charging.calibrate import PlugCalibration
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.recognition.own_arm import arm_surface
from armsight.robots.robot import Robot

AXES = ((235, 53, 50), (30, 220, 60), (56, 130, 248))
CLOUD = (56, 189, 248)
LENGTH = 0.09
"""Of the axes of a frame [m]."""


def over_arm(
    picture: Bytes,
    lens: PinholeCamera,
    robot: Robot,
    joints: JointVector,
    answer: PlugCalibration,
) -> ColorImage:
    """A grey picture of the pair's left lens with the arm as calibrated over it.

    Args:
        picture: (h, w).
        lens: that took it.
        robot: the arm with its plug.
        joints: (n,) when it was taken [rad].
        answer: what is believed; the plug is where its mount holds it, not where it hangs.

    Returns:
        (h, w, 3) RGB.
    """
    image = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB), np.uint8)
    T_camera_base = inverse(answer.T_base_camera)
    points, normals = arm_surface(robot).posed_points(joints)
    local = transform(T_camera_base, points)
    facing = np.einsum("ij,ij->i", normals @ T_camera_base[:3, :3].T, local) < 0.0
    pixels, seen = _pixels(lens, local)
    for u, v in pixels[seen & facing]:
        cv2.circle(image, (round(float(u)), round(float(v))), 2, CLOUD, -1, cv2.LINE_AA)
    plug = answer.base_tip(joints)
    flange = plug @ inverse(answer.T_flange_plug)
    for name, T in (("base", np.eye(4)), ("flange", flange), ("plug", plug)):
        _frame(image, lens, T_camera_base @ T, name)
    return image


def _pixels(lens: PinholeCamera, points: Points) -> tuple[Floats, Mask]:
    """(k, 2) pixels, and which lie in the picture."""
    before = points[:, 2] > 0.05
    pixels = np.full((len(points), 2), -1.0)
    pixels[before] = lens.project(points[before])
    size = np.array([lens.width, lens.height])
    return pixels, np.asarray(before & (pixels >= 0).all(1) & (pixels < size).all(1))


def _frame(image: ColorImage, lens: PinholeCamera, T: Pose, name: str) -> None:
    ends = T[:3, 3] + LENGTH * np.vstack([np.zeros(3), T[:3, :3].T])
    pixels, seen = _pixels(lens, ends)
    if not seen[0]:
        return
    at = [(round(float(u)), round(float(v))) for u, v in pixels]
    for k, color in enumerate(AXES):
        if ends[k + 1, 2] > 0.05:
            cv2.line(image, at[0], at[k + 1], color, 3, cv2.LINE_AA)
    place = (at[0][0] + 10, at[0][1] - 10)
    cv2.putText(image, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.8, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(image, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2, cv2.LINE_AA)
