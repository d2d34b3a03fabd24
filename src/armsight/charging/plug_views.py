"""Where the arm may hold its plug before a pair, and in which order it goes there."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector, Mask, Pose, Poses
from armsight.calibration.arm import reach_some
from armsight.calibration.views import FreeCheck, travel_seconds
from armsight.charging.calibrate import PlugCalibration
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.geometry.stereo import StereoPair
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot

DISTANCE = (0.45, 0.85)
"""Of the plug from the pair: nearer it leaves one of the pictures, farther it is too small [m]."""
LEAN, MOST = 0.6, 0.7
"""Greatest turn of the plug about each of its axes away from facing the pair, and greatest angle of
its axis to the line of sight: from farther aside its own sleeve hides its contacts [rad]."""
MARGIN = 1.6
"""Radii of the plug that it keeps from the edges of both pictures."""


def plug_views(
    answer: PlugCalibration,
    robot: Robot,
    pair: StereoPair,
    plug: str,
    count: int,
    rng: np.random.Generator,
    free: FreeCheck | None = None,
) -> tuple[JointPath, Poses]:
    """Configurations that hold the plug before a pair, in both of its pictures.

    Args:
        answer: where pair and plug are believed to be.
        robot: the arm.
        pair: that looks.
        plug: its type.
        count: how many are drawn; fewer can be reached.
        rng: of places and turns.
        free: whether the arm may stand at joint angles.

    Returns:
        (c, n) joints [rad] and (c, 4, 4) the plug in the left lens's frame there.
    """
    drawn: list[Floats] = []
    facing = from_rpy((np.pi, 0.0, 0.0))[:3, :3]
    wide = 0.5 * np.array([pair.left.width / pair.left.fx, pair.left.height / pair.left.fy])
    between = 0.5 * pair.T_left_right[:3, 3]
    radius = PORTS[plug].radius
    for _ in range(20 * count):
        z = rng.uniform(*DISTANCE)
        aside = rng.uniform(-wide, wide)
        turn = from_rpy(rng.uniform(-LEAN, LEAN, 3))[:3, :3]
        T = make_pose(turn @ facing, between + z * np.array([aside[0], aside[1], 1.0]))
        sight = T[:3, 3] / np.linalg.norm(T[:3, 3])
        if -float(T[:3, 2] @ sight) > np.cos(MOST) and in_both(pair, T[None], radius)[0]:
            drawn.append(T)
        if len(drawn) == count:
            break
    if not drawn:
        return np.zeros((0, robot.n)), np.zeros((0, 4, 4))
    C = np.array(drawn)
    flanges = answer.T_base_camera @ C @ inverse(answer.T_flange_plug)
    joints, reached = reach_some(robot, flanges, rng)
    keep = [
        k
        for k in np.flatnonzero(reached)
        if (free is None or free(joints[k]))
        and not hidden_by_arm(robot, joints[k], answer.T_base_camera, C[k], pair, radius)
    ]
    return joints[keep], C[keep]


def hidden_by_arm(
    robot: Robot,
    joints: JointVector,
    T_base_camera: Pose,
    T_camera_plug: Pose,
    pair: StereoPair,
    radius: float,
) -> bool:
    """Whether a link is between either lens and a plug.

    Args:
        robot: the arm; what its last link carries holds the plug, and is behind it.
        joints: (n,) [rad].
        T_base_camera: the left lens.
        T_camera_plug: the plug in its frame.
        pair: the lenses.
        radius: of the plug [m].
    """
    links = np.asarray(robot.spheres.link) < robot.n
    centers = sphere_centers(robot, joints)[links]
    reach = np.asarray(robot.spheres.radius)[links] + radius
    plug = (T_base_camera @ T_camera_plug)[:3, 3]
    for T in (np.eye(4), pair.T_left_right):
        eye = (T_base_camera @ T)[:3, 3]
        way = plug - eye
        share = np.clip((centers - eye) @ way / (way @ way), 0.0, 1.0)
        away = np.linalg.norm(centers - eye - share[:, None] * way, axis=1)
        if (away < reach).any():
            return True
    return False


def in_both(pair: StereoPair, C: Poses, radius: float) -> Mask:
    """Whether both lenses see what has a radius [m] about poses in the left one's frame."""
    good = np.ones(len(C), bool)
    for lens, T in ((pair.left, np.eye(4)), (pair.right, inverse(pair.T_left_right))):
        p = C[:, :3, 3] @ T[:3, :3].T + T[:3, 3]
        before = p[:, 2] > 0.1
        pixel = np.full((len(C), 2), -1.0)
        pixel[before] = lens.project(p[before])
        edge = (MARGIN * radius * lens.fx / np.maximum(p[:, 2], 0.1))[:, None]
        size = np.array([lens.width, lens.height])
        good &= ((pixel > edge) & (pixel < size - edge)).all(1)
    return good


def expected_noise(C: Poses) -> Floats:
    """(c, 6, 6) covariance to expect of a look from its distance (docs/results/port-pose.md)."""
    z = C[:, 2, 3] / 0.5
    sigma = np.stack(
        [1e-4 * z, 1e-4 * z, 2.5e-4 * z**2, *(np.deg2rad(0.4) * z,) * 2, np.deg2rad(0.2) * z], 1
    )
    return np.asarray(np.eye(6) * (sigma**2)[:, None, :])


def tour(
    robot: Robot, start: JointVector, joints: JointPath, speed: float, acceleration: float
) -> tuple[list[int], float]:
    """Order by the shortest next way from a start, and the time of all the ways [s].

    Args:
        robot: the arm.
        start: (n,) where it is.
        joints: (c, n) where it shall go.
        speed: share of its limits.
        acceleration: likewise.
    """
    here, left, order, seconds = start, list(range(len(joints))), [], 0.0
    while left:
        times = travel_seconds(robot, here, joints[left], speed, acceleration)
        k = int(np.argmin(times))
        seconds += float(times[k])
        order.append(left.pop(k))
        here = joints[order[-1]]
    return order, seconds
