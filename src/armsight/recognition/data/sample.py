"""One labelled picture of a robot arm, and the names of what can be in it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, JointVector, Mask, Points, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.robots.catalogue import ROBOT_NAMES, is_path

KNOWN_ROBOTS: tuple[str, ...] = ("ur3", "ur5", "ur10", "iiwa", "panda")
"""The arms that are told apart, in the order of the networks' outputs: a list of its own, which
does not grow with the catalogue."""
NO_ROBOT = "none"
"""``Sample.robot`` of a picture without an arm."""
UNKNOWN_ROBOT = "unknown"
"""``Sample.robot`` of a picture of an arm that is none of the known."""
ROBOT_TYPES: tuple[str, ...] = (*KNOWN_ROBOTS, NO_ROBOT, UNKNOWN_ROBOT)
"""What ``Sample.robot`` is in the sets that come with armsight's own robots; see also
:func:`is_robot_type`."""


def is_robot_type(name: str) -> bool:
    """Whether a sample's robot may be called so.

    One of :data:`ROBOT_TYPES`, another arm of the catalogue, or the path of a user's own.
    """
    return name in ROBOT_TYPES or name in ROBOT_NAMES or is_path(name)


def robot_number(name: str) -> int:
    """A number of each type for random streams; of other arms it follows from the name alone."""
    if name in ROBOT_TYPES:
        return ROBOT_TYPES.index(name)
    return len(ROBOT_TYPES) + zlib.crc32(PurePath(name).name.encode())


@dataclass(frozen=True)
class Sample:
    """A colour picture and what is known of the arm in it.

    Lengths in [m], angles in [rad]; ``camera`` is the optical frame (z forward, x right, y down);
    pixel centres are at whole numbers counted from 0. Of ``none`` there is no pose (NaN), no joint
    and no key point.

    Attributes:
        index: place in its set, from 0.
        seed: of the set.
        scene: number of the room that it was taken in, unique within the set.
        robot: one of :data:`ROBOT_TYPES`, or of a set with a user's own arm the path of that.
        image: (h, w, 3) RGB.
        mask: (h, w) where the robot is seen. A tool, a cable and a stand are no robot.
        link_ids: (h, w) 0 where no robot is seen, i + 1 where link i is (link 0 is the base).
        K: (3, 3) camera matrix [px].
        distortion: (5,) k1, k2, p1, p2, k3 of what the lens still bends; small, often zero.
        T_camera_base: (4, 4) the robot's base in the camera's frame; its last column is the base
            position that T4 to T7 regress.
        q: (n,) joint positions in the URDF's order [rad].
        joints_camera: (n, 3) origins of the joints in the URDF's order, in the camera's frame [m].
        keypoints_camera: (p, 3) the robot's key points in the camera's frame [m]; their order is
            that of ``robot_keypoints(robot)``, the same for every sample of a robot.
        keypoints_px: (p, 2) where they lie in the picture [px], lens included; NaN behind it.
        keypoints_visible: (p,) whether the link that carries each is seen where it lies.
    """

    index: int
    seed: int
    scene: int
    robot: str
    image: ColorImage
    mask: Mask
    link_ids: Bytes
    K: Floats
    distortion: Floats
    T_camera_base: Pose
    q: JointVector
    joints_camera: Points
    keypoints_camera: Points
    keypoints_px: Floats
    keypoints_visible: Mask

    @property
    def base_camera(self) -> Vector3:
        """(3,) origin of the robot's base in the camera's frame [m]."""
        return np.asarray(self.T_camera_base[:3, 3])

    @property
    def camera(self) -> PinholeCamera:
        """The lens that the labels name."""
        height, width = self.image.shape[:2]
        fx, fy, cx, cy = (float(self.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        k1, k2, p1, p2, k3 = (float(k) for k in self.distortion)
        return PinholeCamera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
