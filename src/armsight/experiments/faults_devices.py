"""Devices that go wrong while a cell runs: around those of a simulated cell."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdFrame

OFF = np.deg2rad(2.0)
"""By so much the readings of a joint lie [rad]."""
DRIFT = 1.0
"""In this time they come to that [s]."""


@dataclass
class Trouble:
    """What goes wrong, and when; told by the one who runs the cell, read by everybody.

    Attributes:
        name: of the case; begin, end: [s], inf until it has begun.
        jump: of a clock [s]; joint: whose readings lie; sign: to which side.
    """

    name: str
    jump: float
    joint: int
    sign: float
    begin: float = math.inf
    end: float = math.inf

    def at(self, now: float) -> bool:
        """Whether it is there at ``now`` [s]."""
        return self.begin <= now < self.end


class TroubledCamera:
    """A camera whose clock jumps.

    Args:
        camera: the true one; clock: the cell's; trouble: what goes wrong.
    """

    def __init__(self, camera: Any, clock: Any, trouble: Trouble) -> None:
        self._camera, self._clock, self._trouble = camera, clock, trouble

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def read(self) -> RgbdFrame | None:
        """The newest frame, with the stamp that the camera's clock gives it."""
        frame: RgbdFrame | None = self._camera.read()
        if frame is None or not self._trouble.at(self._clock.now()):
            return frame
        return replace(frame, stamp=frame.stamp + self._trouble.jump)


class TroubledArm:
    """An arm that says what is not so, or does not do what it is told.

    Args:
        arm: the true one; clock: the cell's; trouble: what goes wrong.
    """

    def __init__(self, arm: Any, clock: Any, trouble: Trouble) -> None:
        self._arm, self._clock, self._trouble = arm, clock, trouble
        self._kept: JointState | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arm, name)

    def read(self) -> JointState | None:
        """The newest reading, as it is told."""
        reading: JointState | None = self._arm.read()
        now, trouble = self._clock.now(), self._trouble
        if reading is None or not trouble.at(now):
            self._kept = reading
            return reading
        if trouble.name in ("arm_ahead", "arm_back"):
            return replace(reading, stamp=reading.stamp + trouble.jump)
        if trouble.name == "still" and self._kept is not None:
            return replace(self._kept, stamp=reading.stamp, velocity=0.0 * reading.velocity)
        if trouble.name in ("off", "drifts"):
            share = 1.0 if trouble.name == "off" else min((now - trouble.begin) / DRIFT, 1.0)
            position, velocity = np.array(reading.position), np.array(reading.velocity)
            position[trouble.joint] += trouble.sign * share * OFF
            velocity[trouble.joint] += trouble.sign * OFF / DRIFT * (share < 1.0)
            return replace(reading, position=position, velocity=velocity)
        return reading

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Pass a command on, or what is left of it; says that all was sent."""
        trouble = self._trouble
        if trouble.at(self._clock.now()):
            if trouble.name == "deaf":
                return np.array(velocity, float)
            if trouble.name == "stuck":
                told = np.array(velocity, float)
                told[trouble.joint] = 0.0
                self._arm.command_velocity(told)
                return np.array(velocity, float)
        sent: JointVector = self._arm.command_velocity(velocity)
        return sent

    def stop(self) -> None:
        """Pass the word on, unless words are lost."""
        if self._trouble.name != "deaf" or not self._trouble.at(self._clock.now()):
            self._arm.stop()
