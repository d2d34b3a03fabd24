"""Ours: joint velocities at 125 Hz that bring the tip to a moving goal and keep it there.

Each round the joints for the predicted goal are found from those of the round before, and the arm
is sent there as fast as its joints allow: the error of all joints shrinks by one factor, so that
the way is straight in joint space, with the gain near the goal and with the braking curve far from
it. The goal's own velocity is fed forward. What the arm does until the command acts is played
forward from the commands that were really sent (a Smith predictor), so the drives' delay costs no
gain; what is left, T, allows 1 / (e T) without overshoot (e' = -gain e(t - T)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointVector, Pose, Vector3
from armsight.devices.data import JointState
from armsight.motion.arm_model import DelayedArm
from armsight.motion.data import GuardStatus
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.aim import Aim, Weights, aim_pose, held_under, joint_velocity, joints_for
from armsight.servoing.ceiling import NEAR, Ceiling

SETTLES, THERE = 60, 0.01
"""Rounds after which joints for a goal have settled, and how near they lead to it then [m]."""
FAR = 3.0
"""Joints for the goal that are farther away than this [rad] are looked for anew from here."""


@dataclass(frozen=True)
class LawConfig:
    """Settings of :class:`VelocityLaw`.

    Attributes:
        delay: command to first motion, as declared or measured [s].
        lag: what the guard's ramp and the ticks add to it [s].
        speed, acceleration: shares of the joints' limits that the cell allows.
        brake: share of that acceleration by which the arm slows towards its goal.
        predict: feed the target's velocity forward (an ablation turns it off).
        gain: [1/s] instead of that from the latency; None for that.
        ceiling: what no part of the arm rises above; None without one.
    """

    delay: float = 0.062
    lag: float = 0.06
    speed: float = 0.5
    acceleration: float = 0.6
    brake: float = 0.6
    predict: bool = True
    gain: float | None = None
    ceiling: Ceiling | None = None

    @property
    def safe_gain(self) -> float:
        """1 / (e T): no overshoot with a delay of T."""
        return self.gain if self.gain is not None else 1.0 / (math.e * self.lag)


class VelocityLaw:
    """Turns goals into joint velocities.

    Args:
        robot: the arm with its tool; config: settings; weights: of position against direction.
    """

    def __init__(
        self, robot: Robot, config: LawConfig | None = None, weights: Weights | None = None
    ) -> None:
        self.robot, self.config = robot, config or LawConfig()
        self.weights = weights or Weights()
        limits = robot.limits.scaled(self.config.speed, self.config.acceleration)
        self._velocity, self._acceleration = limits.velocity, limits.acceleration
        self._arm = DelayedArm(self.config.delay, limits.acceleration, robot.limits.acceleration)
        ceiling = self.config.ceiling
        self._ceiling = None if ceiling is None else ceiling.above(robot)
        self._told = -math.inf
        self._wanted: JointVector | None = None

    def reset(self) -> None:
        """Begin anew."""
        self._arm.forget()
        self._told, self._wanted = -math.inf, None

    def led(self) -> None:
        """Something else leads the arm: the next goal is looked for from where it comes to be."""
        self._wanted = None

    def hear(self, status: GuardStatus | None) -> None:
        """What the guard really commanded."""
        if status is not None and status.stamp > self._told:
            self._told = status.stamp
            self._arm.sent(status.stamp, status.command, False)

    def ahead(self, joints: JointState, now: float) -> JointVector:
        """(n,) where the joints will be when a command of ``now`` acts [rad]."""
        return self._arm.ahead(joints, now + self.config.delay).position

    @property
    def pointing(self) -> Vector3 | None:
        """(3,) where the tool's z points at the last goal: under a ceiling not where it should."""
        return None if self._wanted is None else tcp_pose(self.robot, self._wanted)[:3, 2]

    def pose(self, aim: Aim) -> Pose | None:
        """``T_base_tcp`` at an aim; None where the arm would have to rise above its ceiling."""
        wished = aim_pose(aim)
        ceiling, start = self._ceiling, self._wanted
        if ceiling is None or start is None:
            return wished
        q = joints_for(self.robot, aim, start, self.weights, SETTLES, ceiling=ceiling)
        if ceiling.under(self.robot, q) > NEAR:
            return wished
        T = tcp_pose(self.robot, q)
        return T if np.linalg.norm(T[:3, 3] - aim.position) < THERE else None

    def command(
        self, now: float, joints: JointState, aim: Aim, most: float = math.inf
    ) -> JointVector:
        """(n,) joint velocities towards an aim as it will be when they act [rad/s].

        Args:
            now: time [s].
            joints: newest reading.
            aim: the goal.
            most: speed of the tip [m/s] relative to the goal, whose own velocity is kept: the guard
                asks for that near somebody, and a face that comes must be given way to.
        """
        q = self.ahead(joints, now)
        start = self._wanted
        if start is None or np.abs(start - q).max() > FAR:
            start = q
        wanted = joints_for(self.robot, aim, start, self.weights, ceiling=self._ceiling)
        self._wanted = wanted
        error = wanted - q
        size = np.maximum(np.abs(error), 1e-9)
        braking = np.sqrt(2.0 * self.config.brake * self._acceleration / size)
        gain = min(
            self.config.safe_gain, float((self._velocity / size).min()), float(braking.min())
        )
        motion, along = gain * error, np.zeros_like(error)
        if self.config.predict:
            along = joint_velocity(self.robot, wanted, aim.velocity, self.weights)
        if math.isfinite(most):
            J = tcp_jacobian(self.robot, q)[:3]
            motion = min(1.0, most / max(float(np.linalg.norm(J @ motion)), 1e-9)) * motion
        motion = motion + along
        if self._ceiling is not None:  # on its straight way in joint space, too
            motion = held_under(self.robot, q, motion, self._ceiling)
        return np.asarray(motion / max(float((np.abs(motion) / self._velocity).max()), 1.0))
