"""What a picture is labelled with, from where everything stands: the same for every renderer."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, JointVector, Points, Pose, Poses
from armsight.geometry.pose import inverse
from armsight.recognition.data.framing import View
from armsight.recognition.data.keypoints import (
    placed_keypoints,
    robot_keypoints,
    visible_keypoints,
)
from armsight.recognition.data.rows import Row
from armsight.recognition.data.sample import NO_ROBOT


def label_row(
    place: tuple[int, int, int],
    robot: str,
    view: View,
    q: JointVector,
    T_world_link: Poses,
    T_world_base: Pose,
    links: Bytes,
    words: dict[str, float | str],
) -> Row:
    """The line of a picture in its shard.

    Args:
        place: index of the sample, seed of the set, scene.
        robot: type of the sample; where it is none, the arm's place says nothing.
        view: the camera.
        q: (n,) joint positions [rad].
        T_world_link: (n + 1, 4, 4) true poses of the links.
        T_world_base: the arm's base.
        links: (h, w) which link each pixel sees, as in ``Sample.link_ids``.
        words: what the statistics tell of the scene.
    """
    index, seed, scene = place
    lens, T_camera_world = view.lens, inverse(view.T_world_camera)
    keypoints = robot_keypoints(robot)
    joints: Points
    points: Points
    if robot == NO_ROBOT:
        q, joints, points = np.empty(0), np.empty((0, 3)), np.empty((0, 3))
        T_camera_base = np.full((4, 4), np.nan)
    else:
        T_camera_link = T_camera_world @ T_world_link
        joints, points = T_camera_link[1:, :3, 3], placed_keypoints(keypoints, T_camera_link)
        T_camera_base = np.asarray(T_camera_world @ T_world_base)
    pixels = lens.project(points)
    return Row(
        index,
        seed,
        scene,
        robot,
        f"images/{index:06d}.jpg",
        f"links/{index:06d}.png",
        lens.width,
        lens.height,
        lens.K,
        np.array(lens.distortion),
        T_camera_base,
        q,
        joints,
        points,
        pixels,
        visible_keypoints(keypoints, pixels, links),
        words,
    )
