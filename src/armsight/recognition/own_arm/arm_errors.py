"""How far an arm's links are from where its angles and its drawing put them.

Joint zeros, lengths and sag are the same in all pictures, what the arm moved between stamp and
exposure is another in each: more pictures tell nothing against the former. Sizes are those of an
industrial arm that nobody has calibrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointVector, Points, Pose
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class ArmErrors:
    """Standard deviations.

    Attributes:
        zero: of a joint's zero, all but the first and the last joint's [rad]: these are where the
            base and the tool are.
        length: of each part of a link's length [m].
        sag: of the bending of the second joint and of the next one parallel to it, with the arm
            stretched out [rad].
        exposure: of each joint between what was told and the exposure, in each picture anew [rad]:
            a stamp's 2 ms at 1 rad/s.
    """

    zero: float = float(np.deg2rad(0.05))
    length: float = 0.0005
    sag: float = 0.0005
    exposure: float = 0.002


TYPICAL = ArmErrors()


def link_errors(robot: Robot, joints: Sequence[JointVector], errors: ArmErrors) -> Floats:
    """How each link stands elsewhere in each picture, one column an independent error.

    Args:
        robot: the arm.
        joints: of each of v pictures, (n,) [rad].
        errors: their sizes.

    Returns:
        (v, n + 1, 6, m) twists in ``base`` (translation of what is at its origin [m], rotation
        [rad]), of one standard deviation each.
    """
    n, v = robot.n, len(joints)
    columns: list[Floats] = []
    posed = [link_poses(robot, q) for q in joints]
    turns = np.stack([_turns(robot, T) for T in posed])  # (v, n, 6)
    for i in range(1, n - 1):
        columns.append(_distal(errors.zero * turns[:, i], i, n))
    for i in range(1, n):
        for k in range(3):
            if abs(robot.T_link_joint[i, k, 3]) < 1e-3:
                continue
            shift = np.zeros((v, 6))
            shift[:, :3] = [errors.length * T[i, :3, k] for T in posed]
            columns.append(_distal(shift, i, n))
    for i in _sagging(robot):
        lever = np.array([_lever(robot, T, i) for T in posed])
        columns.append(_distal(errors.sag * lever[:, None] * turns[:, i], i, n))
    for picture in range(v):
        for i in range(n):
            alone = np.zeros((v, 6))
            alone[picture] = errors.exposure * turns[picture, i]
            columns.append(_distal(alone, i, n))
    return np.stack(columns, axis=-1)


def _sagging(robot: Robot) -> list[int]:
    """The second joint, and the next one that is parallel to it at zero; of few joints none."""
    T = link_poses(robot, np.zeros(robot.n))
    axis = np.einsum("nij,nj->ni", T[1:, :3, :3], robot.axis)
    parallel = [i for i in range(2, robot.n) if abs(float(axis[i] @ axis[1])) > 0.99]
    return [k for k in (1, *parallel[:1]) if k < robot.n]


def _turns(robot: Robot, T: Floats) -> Floats:
    """(n, 6) twist in ``base`` of what hangs on each joint as it turns."""
    axis = np.einsum("nij,nj->ni", T[1:, :3, :3], robot.axis)
    return np.hstack([np.cross(T[1:, :3, 3], axis), axis])


def _distal(twist: Floats, joint: int, n: int) -> Floats:
    """(v, n + 1, 6): a twist of all links beyond a joint."""
    out = np.zeros((len(twist), n + 1, 6))
    out[:, joint + 1 :] = twist[:, None]
    return out


def _lever(robot: Robot, T: Floats, joint: int) -> float:
    """Gravity's torque about a joint, as a share of that with the arm stretched out."""
    axis = T[joint + 1, :3, :3] @ robot.axis[joint]
    arm = T[-1, :3, 3] - T[joint + 1, :3, 3]
    return float(axis @ np.cross(arm, [0.0, 0.0, -1.0]) / robot.reach)


def in_camera(twists: Floats, T_camera_base: Pose) -> Floats:
    """(..., 6, m) twists in ``base`` as twists in the camera's frame."""
    R, t = T_camera_base[:3, :3], T_camera_base[:3, 3]
    turned = np.einsum("ij,...jm->...im", R, twists[..., 3:, :])
    moved = np.einsum("ij,...jm->...im", R, twists[..., :3, :])
    moved = moved + np.cross(t, turned, axisb=-2, axisc=-2)
    return np.concatenate([moved, turned], axis=-2)


def link_places(robot: Robot, joints: Sequence[JointVector], T_camera_base: Pose) -> Points:
    """(v, n + 1, 3) where each link's frame is in the camera's frame, in each of v pictures [m]."""
    origins = np.stack([link_poses(robot, q)[:, :3, 3] for q in joints])
    return np.asarray(origins @ T_camera_base[:3, :3].T + T_camera_base[:3, 3])
