"""How what the force sensor carries speeds up: its inertia is felt, and is no contact."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Vector3
from armsight.devices.data import JointState
from armsight.geometry.pose import transform
from armsight.robots.kernels import jacobian
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot

BETWEEN = (1e-3, 0.03)
"""Two readings of the joints this far apart say how the tool speeds up [s]."""
MOST = 20.0
"""No arm speeds its tool up more than this; readings that say so are none [m/s^2]."""


class ToolMotion:
    """Acceleration of the tool's centre of mass, by the joints' readings.

    Args:
        robot: with its tool.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        center = np.zeros(3) if robot.tool is None else np.asarray(robot.tool.center_of_mass, float)
        self._center = transform(robot.T_last_flange, center[None])[0]
        self.forget()

    def forget(self) -> None:
        """Begin anew (the clock jumped)."""
        self._last: tuple[float, Vector3] | None = None
        self._pull: Vector3 = np.zeros(3)

    def take(self, joints: JointState) -> Vector3:
        """(3,) acceleration in ``base`` between the two newest readings [m/s^2].

        Zero where they are too far apart, or say what cannot be: the inertia then counts as touch.
        """
        before = self._last
        if before is not None and joints.stamp == before[0]:
            return self._pull
        poses = link_poses(self._robot, joints.position)
        center = transform(poses[-1], self._center[None])[0]
        J = jacobian(poses, self._robot.axis, self._robot.n, np.ascontiguousarray(center))
        velocity = np.asarray(J[:3] @ joints.velocity)
        self._pull = np.zeros(3)
        if before is not None and BETWEEN[0] < joints.stamp - before[0] < BETWEEN[1]:
            pull = (velocity - before[1]) / (joints.stamp - before[0])
            if float(pull @ pull) < MOST**2:
                self._pull = np.asarray(pull)
        self._last = (joints.stamp, velocity)
        return self._pull
