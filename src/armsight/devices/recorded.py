"""Devices that say again what was recorded: whoever plays the recording delivers, they pass on.

A recorded arm cannot be moved: it takes every command and says that it sent none.
"""

from __future__ import annotations

import threading

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame


class RecordedClock:
    """The recording's time; moved by whoever plays it."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Seconds on the recording's clock."""
        return self._now

    def set(self, now: float) -> None:
        """Move to a time [s]."""
        self._now = now


class RecordedArm:
    """An arm that moves as it did."""

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._joint_names = joint_names
        self._state: JointState | None = None

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._joint_names

    def deliver(self, state: JointState | None) -> None:
        """A reading arrives; None forgets the last one."""
        self._state = state

    def read(self) -> JointState | None:
        """The newest reading that has arrived."""
        return self._state

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Nothing moves: (n,) zeros [rad/s] were sent."""
        return np.zeros(len(self._joint_names))

    def stop(self) -> None:
        """Nothing moves anyway."""


class RecordedCamera:
    """A camera that sees what it saw."""

    def __init__(self, info: RgbdCameraInfo) -> None:
        self._info = info
        self._lock = threading.Lock()
        self._frame: RgbdFrame | None = None

    @property
    def info(self) -> RgbdCameraInfo:
        """What was known of it."""
        return self._info

    def deliver(self, frame: RgbdFrame | None) -> None:
        """A frame arrives; None forgets one that was not read."""
        with self._lock:
            self._frame = frame

    def read(self) -> RgbdFrame | None:
        """The newest frame that has arrived since the last call, or None."""
        with self._lock:
            frame, self._frame = self._frame, None
            return frame

    def want_color(self, wanted: bool) -> None:
        """Colour is there or not: the recording cannot be asked."""
