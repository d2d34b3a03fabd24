"""Devices of a simulated world that several threads use: one lock for all of them.

Only needed when a simulated cell runs under the wall clock; a real driver locks for itself.
"""

from __future__ import annotations

import threading

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.protocols import Arm, RgbdCamera


class SharedArm:
    """An arm behind a lock."""

    def __init__(self, arm: Arm, lock: threading.RLock) -> None:
        self._arm = arm
        self._lock = lock

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._arm.joint_names

    def read(self) -> JointState | None:
        """The newest reading."""
        with self._lock:
            return self._arm.read()

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Ask for joint velocities [rad/s]."""
        with self._lock:
            return self._arm.command_velocity(velocity)

    def stop(self) -> None:
        """Brake and hold."""
        with self._lock:
            self._arm.stop()


class SharedCamera:
    """A depth camera behind a lock."""

    def __init__(self, camera: RgbdCamera, lock: threading.RLock) -> None:
        self._camera = camera
        self._lock = lock

    @property
    def info(self) -> RgbdCameraInfo:
        """What is known of it."""
        return self._camera.info

    def read(self) -> RgbdFrame | None:
        """The newest frame since the last call."""
        with self._lock:
            return self._camera.read()

    def want_color(self, wanted: bool) -> None:
        """Ask for colour or spare it."""
        with self._lock:
            self._camera.want_color(wanted)
