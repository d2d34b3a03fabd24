"""Draws arms over their picture."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, JointVector, Points, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.recognition.any_arm.reach import reach_of
from armsight.recognition.any_arm.sighting import Arm, Sighting
from armsight.recognition.drawing import draw_skeleton, draw_words, thickness
from armsight.recognition.own_arm.kernels import lens_array
from armsight.recognition.own_arm.surface import arm_surface, drawn
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot

_TINTS = ((255, 170, 0), (0, 190, 255), (160, 110, 255), (90, 220, 90))
SURE = 0.5
GUESS = 0.2
"""Trust from which a skeleton is drawn: one that is hardly ever right would look certain."""


def draw(image: ColorImage, found: Sighting) -> ColorImage:
    """(h, w, 3) copy with each arm's mask, skeleton, type and how sure it is.

    Joints are red and the base is magenta; a skeleton that is not believed is grey, and one that is
    hardly a guess is not drawn.
    """
    out = np.ascontiguousarray(image).copy()
    thick = thickness(out)
    for k, arm in enumerate(found.arms):
        tint = _TINTS[k % len(_TINTS)]
        seen = arm.mask >= SURE
        # Of the arm's pixels alone: a phone's whole picture in double precision takes gigabytes.
        out[seen] = (0.65 * out[seen] + 0.35 * np.array(tint)).astype(np.uint8)
        shape = seen.astype(np.uint8)
        outline, _ = cv2.findContours(shape, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(out, outline, -1, tint, thick)
    for arm in found.arms:
        if arm.T_camera_base is not None and arm.trust >= GUESS:
            draw_skeleton(out, found.pixels(arm), arm.believed)
    draw_words(out, [*(_title(arm) for arm in found.arms), *found.notes], 1700)
    return out


def draw_placed(
    image: ColorImage,
    lens: PinholeCamera,
    robot: Robot,
    q: JointVector,
    T_base_camera: Pose,
    believed: bool,
) -> ColorImage:
    """(h, w, 3) copy with the arm drawn in where a camera at a pose would see it.

    Args:
        image: the picture.
        lens: of the picture.
        robot: the arm.
        q: (n,) its joints [rad].
        T_base_camera: where the camera is said to stand.
        believed: whether that is to be believed; a skeleton that is not is grey.
    """
    out = np.ascontiguousarray(image).copy()
    surface, T = arm_surface(robot), inverse(T_base_camera)
    size = (image.shape[1], image.shape[0])
    seen = _bent(transform(T, surface.posed(q)), lens)
    mask = drawn(surface, seen, lens_array(lens), size)[1] >= 0
    outline, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(out, outline, -1, _TINTS[0], thickness(out))
    places = transform(T, link_poses(robot, q)[:, :3, 3])
    draw_skeleton(out, lens.project(places), believed)
    return out


def _bent(points: Points, lens: PinholeCamera) -> Points:
    """(n, 3) points in the camera's frame, where an ideal lens sees them as this one does [m].

    What lies behind, or a picture's width beside the picture, stays: the lens is unknown there.
    """
    size = np.array([lens.width, lens.height])
    out, ahead = points.copy(), points[:, 2] > 0.0
    ideal = replace(lens, distortion=(0.0,) * 5).project(points[ahead])
    near = np.abs(ideal - 0.5 * size).max(axis=1) < 1.5 * size.max()
    rows = np.flatnonzero(ahead)[near]
    shift = (lens.project(points[rows]) - ideal[near]) / np.array([lens.fx, lens.fy])
    out[rows, :2] += shift * points[rows, 2:]
    return out


def mask_of(found: Sighting, shape: tuple[int, ...]) -> Bytes:
    """(h, w) 255 where any arm certainly is, less where it is less sure."""
    both = np.zeros(shape[:2], np.float32)
    for arm in found.arms:
        both = np.maximum(both, arm.mask)
    return np.asarray(np.round(255.0 * np.clip(both, 0, 1)), np.uint8)


def _title(arm: Arm) -> str:
    share = arm.types.get(arm.robot, 0.0)
    words = f"{' or '.join((arm.robot, *arm.alike))} {100 * share:.0f} %"
    if share < SURE:
        words = f"an arm, perhaps {words}"
    if arm.T_camera_base is not None and arm.trust >= GUESS:
        words += f", base {float(np.linalg.norm(arm.base)):.2f} m away"
    if not math.isnan((reach := reach_of(arm)).distance):
        words += f"; {reach.words()}"
    return f"{words}; {arm.problem}" if arm.problem else f"{words}; trust {100 * arm.trust:.0f} %"
