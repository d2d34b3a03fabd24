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

from armsight.arrays import JointVector
from armsight.devices.data import JointState
from armsight.motion.arm_model import DelayedArm
from armsight.motion.data import GuardStatus
from armsight.robots.kinematics import tcp_jacobian
from armsight.robots.robot import Robot
from armsight.servoing.aim import Aim, Weights, joint_velocity, joints_for

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
    """

    delay: float = 0.062
    lag: float = 0.06
    speed: float = 0.5
    acceleration: float = 0.6
    brake: float = 0.6
    predict: bool = True
    gain: float | None = None

    @property
    def safe_gain(self) -> float:
        """1 / (e T): no overshoot with a delay of T."""
        return self.gain if self.gain is not None else 1.0 / (math.e * self.lag)


class VelocityLaw:
    """Turns goals into joint velocities.

    Args:
        robot: the arm with its tool; config: settings; weights: of position against direction.

    Attributes:
        error: of the tip where the last command will act [m].
    """

    def __init__(
        self, robot: Robot, config: LawConfig | None = None, weights: Weights | None = None
    ) -> None:
        self.robot, self.config = robot, config or LawConfig()
        self.weights = weights or Weights()
        limits = robot.limits.scaled(self.config.speed, self.config.acceleration)
        self._velocity, self._acceleration = limits.velocity, limits.acceleration
        self._arm = DelayedArm(self.config.delay, limits.acceleration, robot.limits.acceleration)
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
        self._wanted = wanted = joints_for(self.robot, aim, start, self.weights)
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
        return np.asarray(motion / max(float((np.abs(motion) / self._velocity).max()), 1.0))
