"""A switch behind a driver: somebody's word that nobody is in the cell."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from armsight.devices.clock import WallClock
from armsight.devices.data import SwitchState
from armsight.devices.driven_sensor import DrivenSensor
from armsight.devices.line import DeviceHealth
from armsight.devices.port import SwitchDriver, SwitchReading, SwitchSettings
from armsight.errors import DeviceError


class DrivenSwitch:
    """Implements :class:`armsight.devices.protocols.Switch` over a driver of the port."""

    name = "empty switch"

    def __init__(
        self,
        settings: SwitchSettings,
        opener: Callable[[SwitchSettings], SwitchDriver],
        clock: WallClock,
    ) -> None:
        """Open the switch.

        Raises:
            DeviceError: it cannot be opened.
        """
        period = 1.0 / settings.rate  # its driver need not wait
        self._sensor: DrivenSensor[SwitchReading, SwitchState] = DrivenSensor(
            self.name,
            lambda: opener(settings),
            lambda driver: 0.0,
            self._state,
            clock,
            before=lambda driver: time.sleep(period),
        )

    def read(self) -> SwitchState | None:
        """The newest reading since the last call, or None.

        Raises:
            DeviceError: the switch is lost; it is being opened again.
        """
        state = self._sensor.take()
        return state and replace(state, stamp=self._sensor.clock.at(state.stamp))

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._sensor.health()

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self._sensor.close()

    def _state(self, reading: SwitchReading, stamp: float, arrival: float) -> SwitchState:
        if not isinstance(reading.on, bool):
            raise DeviceError(f"{self.name}: on is {reading.on!r}, expected True or False")
        return SwitchState(stamp, reading.on)
