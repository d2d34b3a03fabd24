"""Devices that say again what was recorded: whoever plays the recording delivers, they pass on.

A recorded arm cannot be moved: it takes every command and says that it sent none.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import (
    ArmStatus,
    GripperState,
    JointState,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
    Wrench,
)
from armsight.devices.newest import Newest

Reading = TypeVar("Reading")


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
        self._status: ArmStatus | None = None

    @property
    def status(self) -> ArmStatus | None:
        """The controller's word at that time, or None where none was recorded."""
        return self._status

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._joint_names

    def deliver(self, state: JointState | None) -> None:
        """A reading arrives; None forgets everything."""
        self._state = state
        if state is None:
            self._status = None

    def deliver_status(self, status: ArmStatus) -> None:
        """The controller's word arrives."""
        self._status = status

    def read(self) -> JointState | None:
        """The newest reading that has arrived."""
        return self._state

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Nothing moves: (n,) zeros [rad/s] were sent."""
        return np.zeros(len(self._joint_names))

    def stop(self) -> None:
        """Nothing moves anyway."""


class RecordedSensor(Generic[Reading]):
    """A device whose readings are delivered and read once."""

    def __init__(self) -> None:
        self._newest: Newest[Reading] = Newest()

    def deliver(self, reading: Reading | None) -> None:
        """A reading arrives; None forgets one that was not read."""
        if reading is None:
            self._newest.clear()
        else:
            self._newest.put(reading)

    def read(self) -> Reading | None:
        """The newest reading that has arrived since the last call, or None."""
        return self._newest.take()


class RecordedCamera(RecordedSensor[RgbdFrame]):
    """A camera that sees what it saw."""

    def __init__(self, info: RgbdCameraInfo) -> None:
        super().__init__()
        self._info = info

    @property
    def info(self) -> RgbdCameraInfo:
        """What was known of it."""
        return self._info

    def want_color(self, rate: float, scale: float = 1.0) -> None:
        """Colour is there or not: the recording cannot be asked."""


class RecordedStereo(RecordedSensor[StereoFrame]):
    """A stereo pair that sees what it saw."""

    def __init__(self, info: StereoInfo) -> None:
        super().__init__()
        self._info = info

    @property
    def info(self) -> StereoInfo:
        """What was known of it."""
        return self._info

    def want_pictures(self, wanted: bool) -> None:
        """Pairs are there or not: the recording cannot be asked."""


class RecordedWrench(RecordedSensor[Wrench]):
    """A force sensor that feels what it felt: it hands over every reading, as live ones do."""

    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[Wrench] = deque(maxlen=1024)

    def deliver(self, reading: Wrench | None) -> None:
        """A reading arrives; None forgets those that were not read."""
        if reading is None:
            self._waiting.clear()
        else:
            self._waiting.append(reading)

    def read(self) -> Wrench | None:
        """The oldest reading that was not handed over yet, or None."""
        return self._waiting.popleft() if self._waiting else None


class RecordedGripper(RecordedSensor[GripperState]):
    """A gripper that moves as it did."""

    def __init__(self, opening: float) -> None:
        super().__init__()
        self._opening = opening

    @property
    def opening(self) -> float:
        """Greatest width [m]."""
        return self._opening

    def move(self, width: float) -> None:
        """Nothing moves: it is a recording."""
