"""Force sensors and grippers behind drivers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.devices.clock import WallClock
from armsight.devices.data import GripperState, Wrench
from armsight.devices.driven_sensor import DrivenSensor
from armsight.devices.line import Asked, DeviceHealth
from armsight.devices.port import (
    GripperDriver,
    GripperReading,
    GripperSettings,
    WrenchDriver,
    WrenchReading,
    WrenchSettings,
)
from armsight.errors import DeviceError

MOVE_AGAIN = 0.5
"""A gripper that did not take a width is told it again after this time [s]."""


class DrivenWrench:
    """Implements :class:`armsight.devices.protocols.ForceSensor` over a driver of the port."""

    name = "wrench"

    def __init__(
        self,
        settings: WrenchSettings,
        opener: Callable[[WrenchSettings], WrenchDriver],
        clock: WallClock,
    ) -> None:
        """Open the sensor.

        Raises:
            DeviceError: it cannot be opened.
        """
        self._sensor: DrivenSensor[WrenchReading, Wrench] = DrivenSensor(
            self.name, lambda: opener(settings), lambda driver: 0.0, self._wrench, clock
        )

    def read(self) -> Wrench | None:
        """The newest reading since the last call, or None.

        Raises:
            DeviceError: the sensor is lost; it is being opened again.
        """
        wrench = self._sensor.take()
        return wrench and replace(wrench, stamp=self._sensor.clock.at(wrench.stamp))

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._sensor.health()

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self._sensor.close()

    def _wrench(self, reading: WrenchReading, stamp: float, arrival: float) -> Wrench:
        force, torque = (_three(self.name, w, getattr(reading, w)) for w in ("force", "torque"))
        return Wrench(stamp, force, torque)


class DrivenGripper:
    """Implements :class:`armsight.devices.protocols.Gripper` over a driver of the port."""

    name = "gripper"

    def __init__(
        self,
        settings: GripperSettings,
        opener: Callable[[GripperSettings], GripperDriver],
        clock: WallClock,
    ) -> None:
        """Open the gripper.

        Raises:
            DeviceError: it cannot be opened.
        """
        self._settings = settings
        self._sensor: DrivenSensor[GripperReading, GripperState] = DrivenSensor(
            self.name, lambda: opener(settings), lambda driver: 0.0, self._state, clock
        )
        self._lock = threading.Lock()
        self._width = np.nan
        self._told: Asked | None = None
        self._told_at = -np.inf

    @property
    def opening(self) -> float:
        """Greatest width [m]."""
        return self._settings.opening

    def read(self) -> GripperState | None:
        """The newest reading since the last call, or None.

        Raises:
            DeviceError: the gripper is lost, and being opened again; or there is no new reading,
                and it did not take its width, which it is told again.
        """
        state = self._sensor.take()
        refused = self._tell_again()
        if state is not None:
            return replace(state, stamp=self._sensor.clock.at(state.stamp))
        if refused is not None:
            raise refused
        return None

    def move(self, width: float) -> None:
        """Begin to open or close to a width [m]; waits for nothing: grippers may be slow.

        Raises:
            DeviceError: no such width, or the gripper is lost. What it refuses is told again, and
                :meth:`read` says so.
        """
        width = checked_width(width, self.opening)
        self._sensor.line.check()
        with self._lock:
            self._width = width
            self._tell()

    def _tell(self) -> None:
        width = self._width

        def job(driver: Any) -> None:
            if width == self._width:  # nothing else was wanted while this one waited
                driver.move(width)

        self._told_at = self._sensor.clock.source()
        self._told = self._sensor.line.post("move()", job)

    def _tell_again(self) -> DeviceError | None:
        """Why the gripper did not take its width, or None; told again when it is time to."""
        with self._lock:
            refused = None if self._told is None else self._told.error
            if refused is not None and self._sensor.clock.source() > self._told_at + MOVE_AGAIN:
                self._tell()
            return refused

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._sensor.health()

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self._sensor.close()

    def _state(self, reading: GripperReading, stamp: float, arrival: float) -> GripperState:
        width = float(reading.width)
        if not -0.01 <= width <= 1.5 * self.opening + 0.01:
            raise DeviceError(
                f"{self.name}: reads a width of {width:g}, expected metres from 0 to "
                f"{self.opening:g}"
            )
        holding = None if reading.holding is None else bool(reading.holding)
        return GripperState(stamp, width, bool(reading.moving), holding)


def checked_width(width: float, opening: float) -> float:
    """A width that a gripper can be told to take.

    Raises:
        DeviceError: it is not within 0 and the opening.
    """
    if not 0.0 <= width <= opening + 1e-9:
        raise DeviceError(f"gripper: a width is 0 to {opening:g} m, not {width!r}")
    return float(width)


def _three(name: str, what: str, values: Floats) -> Floats:
    vector = np.array(values, float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise DeviceError(f"{name}: {what} is {vector.tolist()}, expected 3 finite numbers")
    return vector
