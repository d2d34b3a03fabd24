"""The arm's own errors: joint offsets, link lengths, sag; their effect on the flange.

Only what cameras and a board can tell is a parameter: the first joint's offset and height move the
base, the last joint's offset moves the flange, and both are absorbed by camera and board poses.
Lengths along parallel axes cannot be told apart; their priors share the error between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armsight.arrays import Floats, JointPath, Poses
from armsight.calibration.arm import body_screws, joint_frames
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class RobotErrors:
    """Which errors an arm has, and how large they may be.

    Attributes:
        robot: the nominal arm.
        offset_sigma: of a joint's zero [rad].
        length_sigma: of a link's length [m].
        sag_sigma: bending of a joint under gravity with the arm stretched out [rad].
    """

    robot: Robot
    offset_sigma: float = float(np.deg2rad(0.05))
    length_sigma: float = 0.0005
    sag_sigma: float = 0.0005
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)

    @cached_property
    def offset_joints(self) -> tuple[int, ...]:
        """Joints whose zero is a parameter: all but the first and the last."""
        return tuple(range(1, self.robot.n - 1))

    @cached_property
    def length_axes(self) -> tuple[tuple[int, int], ...]:
        """(joint, axis) of each length: joint i's origin along an axis of its parent's frame."""
        origin = self.robot.T_link_joint[:, :3, 3]
        return tuple(
            (i, k) for i in range(1, self.robot.n) for k in range(3) if abs(origin[i, k]) > 1e-3
        )

    @cached_property
    def sag_joints(self) -> tuple[int, ...]:
        """Joints that bend under gravity: the second and, where there is one, the next parallel."""
        return (1, 2) if self.robot.n == 6 else (1, 3)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.offset_joints) + len(self.length_axes) + len(self.sag_joints)

    @cached_property
    def sigma(self) -> Floats:
        """(size,) prior standard deviations."""
        return np.concatenate(
            [
                np.full(len(self.offset_joints), self.offset_sigma),
                np.full(len(self.length_axes), self.length_sigma),
                np.full(len(self.sag_joints), self.sag_sigma),
            ]
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for each parameter, with its unit."""
        joint = self.robot.joint_names
        return (
            *(f"zero of {joint[i]} [rad]" for i in self.offset_joints),
            *(f"origin of {joint[i]} along {'xyz'[k]} [m]" for i, k in self.length_axes),
            *(f"sag of {joint[i]} at full reach [rad]" for i in self.sag_joints),
        )

    def flange_poses(self, joints: JointPath, theta: Floats) -> tuple[Poses, Floats]:
        """Flange and how each error moves it.

        Args:
            joints: (v, n) joint angles as the arm reports them [rad].
            theta: (size,) errors.

        Returns:
            (v, 4, 4) ``T_base_flange``, and (v, 6, size) derivative as a body twist:
            ``T(theta + d) = T(theta) exp(B d)`` to first order, translation first.
        """
        robot, v = self.robot, len(joints)
        n_offset, n_length = len(self.offset_joints), len(self.length_axes)
        angle = np.array(joints, float, copy=True)
        angle[:, list(self.offset_joints)] += theta[:n_offset]
        lever = self._sag_lever(np.asarray(joints, float))
        angle[:, list(self.sag_joints)] += lever * theta[n_offset + n_length :]

        origins = robot.T_link_joint[:, :3, 3].copy()
        for (i, k), d in zip(self.length_axes, theta[n_offset : n_offset + n_length]):
            origins[i, k] += d
        parents, frames, T = joint_frames(robot, angle, origins)
        screws = body_screws(robot, frames, T)
        R_t = np.swapaxes(T[:, :3, :3], 1, 2)
        B = np.zeros((v, 6, self.size))
        for column, i in enumerate(self.offset_joints):
            B[:, :, column] = screws[:, :, i]
        for column, (i, k) in enumerate(self.length_axes, n_offset):
            B[:, :3, column] = np.einsum("vij,vj->vi", R_t, parents[i][:, :3, k])
        for column, i in enumerate(self.sag_joints):
            B[:, :, n_offset + n_length + column] = screws[:, :, i] * lever[:, column : column + 1]
        return T, B

    def _sag_lever(self, joints: JointPath) -> Floats:
        """(v, sag joints) gravity's torque about a joint as a share of that at full reach."""
        _, frames, flange = joint_frames(self.robot, joints)
        lever = np.empty((len(joints), len(self.sag_joints)))
        for column, i in enumerate(self.sag_joints):
            w = frames[i][:, :3, :3] @ self.robot.axis[i]
            arm = flange[:, :3, 3] - frames[i][:, :3, 3]
            torque = np.cross(arm, np.asarray(self.gravity))
            lever[:, column] = np.einsum("vi,vi->v", w, torque) / self.robot.reach
        return lever
