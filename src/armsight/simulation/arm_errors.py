"""How the arm that stands there differs from the one in the data: geometry, droop, repeatability.

Sizes for scale 1 (design notes on calibration): joints 2 to 5 are off by 0.05 deg, lengths by
0.5 mm, the stretched arm sags by 0.4 mm.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Poses
from armsight.geometry.pose import exp
from armsight.robots.robot import Robot

JOINT_OFFSET = np.deg2rad(0.05)
LENGTH = 0.0005
SAG = 0.0004


def true_geometry(robot: Robot, scale: float, rng: np.random.Generator) -> Poses:
    """(n, 4, 4) ``T_link_joint`` of the arm as built.

    The first joint keeps its zero and place: they are part of where the base is.
    """
    T = np.array(robot.T_link_joint)
    for joint in range(1, robot.n):
        offset = rng.standard_normal() * JOINT_OFFSET * (1.0 if joint < robot.n - 1 else 0.0)
        shift = rng.standard_normal(3) * LENGTH * (np.abs(T[joint, :3, 3]) > 1e-6)
        twist = np.concatenate([np.zeros(3), robot.axis[joint] * offset])
        T[joint] = T[joint] @ exp(scale * twist)
        T[joint, :3, 3] += scale * shift
    return T


def compliance(robot: Robot, scale: float, greatest_torque: float) -> float:
    """Twist of a joint under load [rad/(N m)], such that the stretched arm's tip sags as stated."""
    return scale * SAG / (robot.reach * max(greatest_torque, 1e-6))
