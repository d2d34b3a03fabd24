"""Forward kinematics and Jacobians of a :class:`Robot`, compiled, in the base frame."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector, Points, Pose, Poses
from armsight.robots import kernels
from armsight.robots.robot import Robot


def link_poses(robot: Robot, q: JointVector) -> Poses:
    """(n + 1, 4, 4) ``T_base_link`` of every link at (n,) joint positions [rad]."""
    return np.asarray(kernels.chain_poses(_joints(robot, q), robot.T_link_joint, robot.axis))


def flange_pose(robot: Robot, q: JointVector) -> Pose:
    """``T_base_flange`` at (n,) joint positions [rad]."""
    return np.asarray(link_poses(robot, q)[-1] @ robot.T_last_flange)


def tcp_pose(robot: Robot, q: JointVector) -> Pose:
    """``T_base_tcp``: the tool's working point, or the flange without a tool."""
    flange = flange_pose(robot, q)
    return flange if robot.tool is None else np.asarray(flange @ robot.tool.T_flange_tcp)


def flange_jacobian(robot: Robot, q: JointVector) -> Floats:
    """(6, n) geometric Jacobian of the flange in base axes: linear [m/rad], then angular."""
    poses = link_poses(robot, q)
    origin = poses[-1, :3, :3] @ robot.T_last_flange[:3, 3] + poses[-1, :3, 3]
    return np.asarray(kernels.jacobian(poses, robot.axis, robot.n, origin))


def tcp_jacobian(robot: Robot, q: JointVector) -> Floats:
    """(6, n) geometric Jacobian of the tip in base axes: linear [m/rad], then angular."""
    poses = link_poses(robot, q)
    T = poses[-1] @ robot.T_last_flange
    if robot.tool is not None:
        T = T @ robot.tool.T_flange_tcp
    return np.asarray(kernels.jacobian(poses, robot.axis, robot.n, T[:3, 3].copy()))


def point_jacobian(robot: Robot, q: JointVector, link: int, point_base: Points) -> Floats:
    """(3, n) Jacobian [m/rad] of a point, given in base, that moves with a link.

    Raises:
        ValueError: there is no such link.
    """
    if not 0 <= link <= robot.n:
        raise ValueError(f"{robot.name} has links 0..{robot.n}, not {link}")
    point = np.ascontiguousarray(point_base, dtype=np.float64).reshape(3)
    return np.asarray(kernels.jacobian(link_poses(robot, q), robot.axis, link, point)[:3])


def sphere_centers(robot: Robot, q: JointVector) -> Points:
    """(m, 3) centres of the body's spheres in base [m]."""
    return np.asarray(
        kernels.carried_points(link_poses(robot, q), robot.spheres.link, robot.spheres.center)
    )


def path_sphere_centers(robot: Robot, path: JointPath) -> Floats:
    """(k, m, 3) centres of the body's spheres in base [m] at each of (k, n) configurations."""
    rows = np.ascontiguousarray(path, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != robot.n:
        raise ValueError(f"{robot.name} has {robot.n} joints, a path of shape {rows.shape} came")
    spheres = robot.spheres
    return np.asarray(
        kernels.path_points(rows, robot.T_link_joint, robot.axis, spheres.link, spheres.center)
    )


def _joints(robot: Robot, q: JointVector) -> JointVector:
    vector = np.ascontiguousarray(q, dtype=np.float64)
    if vector.shape != (robot.n,):
        raise ValueError(f"{robot.name} has {robot.n} joints, an array of {vector.shape} came")
    return vector
