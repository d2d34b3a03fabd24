"""How fast, and how hard, a part of the body may be touched: power and force limiting.

ISO/TS 15066:2016, annex A: two masses that meet with a relative speed v over a spring k press each
other with at most ``F = v sqrt(mu k)``, so that ::

    v = F_max / sqrt(mu k),   1/mu = 1/m_arm + 1/m_region

m_arm is the arm's effective mass at the point and in the direction of contact (Khatib 1987),
``1/m_arm = n . J M^-1 J^T n``; a soft cover in series with the region makes k smaller.
Limits, masses and stiffnesses are in :mod:`armsight.geometry.body_regions`.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Floats, JointVector, Vector3
from armsight.geometry.body_regions import BodyRegion
from armsight.robots.kernels import chain_poses, jacobian
from armsight.robots.robot import Robot

MOST = 0.25
"""Nobody is touched faster than this [m/s], whatever the formula says (ISO 10218-1)."""
ROTOR = 0.1
"""Inertia of a motor seen through its gear that is assumed of every joint [kg m^2]."""


def greatest_force(region: BodyRegion, asked: float) -> float:
    """F_max [N]: what the region stands when it is held fast, and no more than was asked."""
    return min(region.force, asked)


def contact_speed(
    region: BodyRegion, arm_mass: float, force: float, soft: float = math.inf
) -> float:
    """V [m/s] at which a region may be touched, at most :data:`MOST`.

    Args:
        region: of the body.
        arm_mass: m_arm [kg].
        force: F_max [N].
        soft: stiffness of the arm's cover [N/m].
    """
    mu = 1.0 / (1.0 / arm_mass + 1.0 / region.mass)
    k = 1.0 / (1.0 / region.stiffness + 1.0 / soft)
    return min(force / math.sqrt(mu * k), MOST)


def mass_matrix(robot: Robot, q: JointVector) -> Floats:
    """(n, n) inertia of the arm at (n,) [rad], its tool and its motors included [kg m^2]."""
    poses = np.asarray(chain_poses(np.ascontiguousarray(q, float), robot.T_link_joint, robot.axis))
    M: Floats = np.diag(np.full(robot.n, ROTOR))
    bodies: list[tuple[int, float, Floats, Floats]] = [
        (link, float(robot.link_mass[link]), robot.link_com[link], robot.link_inertia[link])
        for link in range(1, robot.n + 1)
    ]
    if robot.tool is not None and robot.tool.mass > 0.0:
        T = robot.T_last_flange
        center = T[:3, :3] @ robot.tool.center_of_mass + T[:3, 3]
        bodies.append((robot.n, robot.tool.mass, center, np.zeros((3, 3))))
    for link, mass, com, inertia in bodies:
        T = poses[link]
        J = np.asarray(jacobian(poses, robot.axis, link, T[:3, :3] @ com + T[:3, 3]))
        turned = T[:3, :3] @ inertia @ T[:3, :3].T
        M += mass * J[:3].T @ J[:3] + J[3:].T @ turned @ J[3:]
    return np.asarray(M)


def effective_mass(robot: Robot, q: JointVector, link: int, point: Vector3, way: Vector3) -> float:
    """m_arm [kg] that a point (3,) in ``base`` of a link has along a unit vector, at (n,) [rad]."""
    poses = np.asarray(chain_poses(np.ascontiguousarray(q, float), robot.T_link_joint, robot.axis))
    row = way @ np.asarray(jacobian(poses, robot.axis, link, np.array(point, float)))[:3]
    inverse = float(row @ np.linalg.solve(mass_matrix(robot, q), row))
    return 1.0 / max(inverse, 1e-9)
