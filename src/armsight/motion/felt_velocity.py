"""How fast a thing comes at the arm that touches it, by what the arm feels.

Cameras tell late how what they see brakes and turns, and a filter believes them later still. Once a
tip on springs touches, the force says it better: what the tip itself does and what it is pressed in
by are together the way of the thing's surface. Of that a filter with fading memory (Morrison 1969;
place, velocity, acceleration) makes the velocity when a command acts.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.devices.data import JointState
from armsight.motion.force_watch import FELT
from armsight.motion.regions import Region
from armsight.motion.tool_motion import BETWEEN
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import SprungTip, press_depth

MEMORY = 0.8
"""What was felt a reading ago counts by this share of what is felt now."""
SETTLED = 8
"""From fewer readings no acceleration is to be had."""
BRAKES = 3.0
"""Nothing that may be touched changes its velocity by more [m/s^2]."""


class FeltVelocity:
    """Of the thing that the tool's tip touches.

    Args:
        robot: with its tool.
        delay: from a command until it acts [s].
    """

    def __init__(self, robot: Robot, delay: float) -> None:
        self._robot, self._delay = robot, delay
        self.forget()

    def forget(self) -> None:
        """Nothing is touched any more."""
        self._readings = 0
        self._last: tuple[float, Vector3, float] = (-math.inf, np.zeros(3), 0.0)
        self._behind = self._speed = self._rate = 0.0
        self.closing: tuple[float, float] = (0.0, 0.0)
        """How fast the tip is pressed in, now and when the next command acts [m/s]."""
        self.faster: Vector3 = np.zeros(3)
        """(3,) what is felt of a velocity in ``base`` beyond what was told [m/s]."""

    def take(
        self,
        joints: JointState,
        told: Vector3,
        push: Vector3 | None,
        gives: tuple[float, SprungTip] | None,
        command: JointVector | None = None,
    ) -> None:
        """What is felt now.

        Only what comes harder than was told counts: what seems to leave may be pushed away.

        Args:
            joints: of the arm.
            told: (3,) velocity of the thing, as it was seen [m/s].
            push: (3,) force on the arm in ``base`` [N], or None.
            gives: stiffness of the thing [N/m] and the tip that alone may touch it, or None.
            command: (n,) joint velocities that the arm was told last [rad/s].
        """
        strength = 0.0 if push is None else float(np.linalg.norm(push))
        if push is None or gives is None or not strength > FELT:
            self.forget()
            return
        stamp, was, deep = self._last
        if joints.stamp == stamp:
            return
        out = push / strength
        tip = tcp_pose(self._robot, joints.position)[:3, 3]
        depth = press_depth(strength, *gives)
        self._last = (joints.stamp, tip, depth)
        passed = joints.stamp - stamp
        if BETWEEN[0] < passed < BETWEEN[1] and self._readings:
            self._follow(float((tip - was) @ out) + depth - deep, passed)
        else:
            self._readings, self._speed = 1, float(told @ out)
            self._behind = self._rate = 0.0
        leaves = out @ tcp_jacobian(self._robot, joints.position)[:3]
        comes = self._speed + self._delay * self._rate
        then = joints.velocity if command is None else command
        self.closing = (
            self._speed - float(leaves @ joints.velocity),
            comes - float(leaves @ then),
        )
        self.faster = max(comes - float(told @ out), 0.0) * out

    def of(self, region: Region) -> Region:
        """A region with the velocity that is felt."""
        if not self.faster.any():
            return region
        return replace(region, velocity=region.velocity + self.faster)

    def _follow(self, came: float, passed: float) -> None:
        """The thing's surface came by so much [m] in a time [s]."""
        self._readings += 1
        memory = min(MEMORY, 1.0 - 1.0 / self._readings)
        off = self._behind + came - passed * (self._speed + 0.5 * passed * self._rate)
        forgets = 1.0 - memory
        self._behind = memory**3 * off
        self._speed += passed * self._rate
        self._speed += 1.5 * forgets**2 * (1.0 + memory) * off / passed
        if self._readings > SETTLED:
            rate = self._rate + forgets**3 * off / passed**2
            self._rate = min(max(rate, -BRAKES), BRAKES)
