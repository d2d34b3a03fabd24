"""Devices for several threads, and an arm for those who only look.

The devices of a simulated world that runs under the wall clock share one lock; a device behind a
driver has a thread of its own and needs none.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import ArmStatus, JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.driven_arm import DrivenArm
from armsight.devices.driven_cameras import DrivenCamera, DrivenStereo
from armsight.devices.driven_hand import DrivenGripper, DrivenWrench
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

    @property
    def status(self) -> ArmStatus | None:
        """The controller's word."""
        with self._lock:
            return self._arm.status

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


class UntouchedArm:
    """An arm that is read and never told anything: looking is not touching."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._arm.joint_names

    @property
    def status(self) -> ArmStatus | None:
        """The controller's word."""
        return self._arm.status

    def read(self) -> JointState | None:
        """The newest reading."""
        return self._arm.read()

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Nothing is sent: (n,) zeros [rad/s]."""
        return np.zeros(len(self.joint_names))

    def stop(self) -> None:
        """Nothing is sent."""


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

    def want_color(self, rate: float, scale: float = 1.0) -> None:
        """Ask for colour or spare it."""
        with self._lock:
            self._camera.want_color(rate, scale)

    def want_infrared(self, wanted: bool) -> None:
        """Ask for the depth lens's picture, where there is one, or spare it."""
        if hasattr(self._camera, "want_infrared"):
            with self._lock:
                self._camera.want_infrared(wanted)

    def stand_by(self, idle: bool) -> None:
        """Nobody looks at the camera, or somebody does again."""
        if hasattr(self._camera, "stand_by"):
            with self._lock:
                self._camera.stand_by(idle)


class SharedSensor:
    """A stereo pair, a force sensor or a gripper behind a lock: its readings."""

    def __init__(self, sensor: Any, lock: threading.RLock) -> None:
        self._sensor = sensor
        self._lock = lock

    def read(self) -> Any:
        """The newest reading since the last call."""
        with self._lock:
            return self._sensor.read()


def shared_arm(arm: Arm, lock: threading.RLock) -> Arm:
    """The arm, behind the lock if it needs one."""
    return arm if isinstance(arm, DrivenArm) else SharedArm(arm, lock)


def shared_camera(camera: RgbdCamera, lock: threading.RLock) -> RgbdCamera:
    """The camera, behind the lock if it needs one."""
    return camera if isinstance(camera, DrivenCamera) else SharedCamera(camera, lock)


def shared_sensors(sensors: Sequence[Any], lock: threading.RLock) -> list[Any]:
    """Other sensors, behind the lock where they need one."""
    own = (DrivenStereo, DrivenWrench, DrivenGripper)
    return [s if isinstance(s, own) else SharedSensor(s, lock) for s in sensors]
