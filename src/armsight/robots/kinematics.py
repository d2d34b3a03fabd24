"""Forward kinematics and Jacobians of a :class:`Robot`, compiled, in the base frame."""

from __future__ import annotations

from armsight.arrays import Floats, JointVector, Points, Pose, Poses
from armsight.robots.robot import Robot


def link_poses(robot: Robot, q: JointVector) -> Poses:
    """(n + 1, 4, 4) ``T_base_link`` of every link at (n,) joint positions [rad]."""
    raise NotImplementedError


def flange_pose(robot: Robot, q: JointVector) -> Pose:
    """``T_base_flange`` at (n,) joint positions [rad]."""
    raise NotImplementedError


def tip_pose(robot: Robot, q: JointVector) -> Pose:
    """``T_base_tip``: the tool's working point, or the flange without a tool."""
    raise NotImplementedError


def flange_jacobian(robot: Robot, q: JointVector) -> Floats:
    """(6, n) geometric Jacobian of the flange in base axes: linear [m/rad], then angular."""
    raise NotImplementedError


def point_jacobian(robot: Robot, q: JointVector, link: int, point_base: Points) -> Floats:
    """(3, n) Jacobian [m/rad] of a point, given in base, that moves with a link."""
    raise NotImplementedError


def sphere_centers(robot: Robot, q: JointVector) -> Points:
    """(m, 3) centres of the body's spheres in base [m]."""
    raise NotImplementedError
