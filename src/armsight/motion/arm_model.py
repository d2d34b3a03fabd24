"""Where the arm will be when a command sent now begins to act: delay and ramps of its drives."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.devices.data import JointState
from armsight.motion.drive_kernels import drive_ahead, stop_path
from armsight.motion.guard_config import GuardConfig
from armsight.robots.robot import Robot

REMEMBERED = 2000
"""Commands that are remembered when no reading comes that would make them the past."""


@dataclass(frozen=True)
class ArmState:
    """(n,) joint positions [rad] and velocities [rad/s] at a time [s]."""

    time: float
    position: JointVector
    velocity: JointVector


class DelayedArm:
    """Remembers the commands on their way and plays them forward from the newest reading.

    With this prediction the position loop sees no delay (a Smith predictor), so a small gain is
    stable however late the drives answer.

    Args:
        delay: from sending a command to its first effect [s].
        acceleration: (n,) ramp of the drives under commands [rad/s^2].
        brake: (n,) ramp of a stop [rad/s^2].
    """

    def __init__(self, delay: float, acceleration: JointVector, brake: JointVector) -> None:
        self.delay = delay
        self.acceleration = np.ascontiguousarray(acceleration, float)
        self.brake = np.ascontiguousarray(brake, float)
        self._sent: deque[tuple[float, JointVector, bool]] = deque(maxlen=REMEMBERED)

    def sent(self, now: float, velocity: JointVector, brake: bool) -> None:
        """A command (or a stop) was sent at ``now`` [s]."""
        self._sent.append((now + self.delay, np.array(velocity, float), brake))

    @property
    def told(self) -> JointVector | None:
        """(n,) what was commanded last [rad/s]; None before that, and after a stop."""
        return None if not self._sent or self._sent[-1][2] else self._sent[-1][1]

    @property
    def acts(self) -> float:
        """When the oldest command that is known acts, or acted [s]; inf before there is one."""
        return self._sent[0][0] if self._sent else math.inf

    def forget(self) -> None:
        """Nothing is known of earlier commands (the clock jumped)."""
        self._sent.clear()

    def ahead(self, joints: JointState, until: float) -> ArmState:
        """State at a time [s] after the reading, given every command sent so far."""
        start = joints.stamp
        while len(self._sent) > 1 and self._sent[1][0] <= start:
            self._sent.popleft()
        q = np.array(joints.position, float)
        v = np.array(joints.velocity, float)
        if until <= start:
            return ArmState(start, q, v)
        rows = [entry for entry in self._sent if entry[0] < until]
        if not rows:
            return ArmState(until, q + v * (until - start), v)
        if rows[0][0] > start:  # what was in force before is unknown: the reading's own speed
            rows.insert(0, (start, v.copy(), False))
        ends = np.array([*(r[0] for r in rows[1:]), until])
        targets = np.array([r[1] for r in rows])
        braking = np.array([r[2] for r in rows])
        drive_ahead(q, v, ends, targets, braking, self.acceleration, self.brake, start)
        return ArmState(until, q, v)

    def after(self, state: ArmState, velocity: JointVector, seconds: float) -> ArmState:
        """State after a command acted for a time [s] on a state."""
        q, v = state.position.copy(), state.velocity.copy()
        until = state.time + seconds
        drive_ahead(
            q,
            v,
            np.array([until]),
            np.ascontiguousarray(velocity, float)[None],
            np.zeros(1, bool),
            self.acceleration,
            self.brake,
            state.time,
        )
        return ArmState(until, q, v)

    def stop_path(self, state: ArmState, pieces: int = 4) -> JointPath:
        """(pieces + 1, n) positions of the stop that begins at a state [rad]."""
        return np.asarray(stop_path(state.position, state.velocity, self.brake, pieces))


def commanded_arm(robot: Robot, config: GuardConfig, share: float = 1.0) -> DelayedArm:
    """The drives as a guard commands them, with this share of the declared delay."""
    allowed = robot.limits.scaled(config.speed, config.acceleration)
    brake = robot.limits.acceleration * max(config.brake, config.acceleration)
    return DelayedArm(share * config.start_delay, allowed.acceleration, brake)
