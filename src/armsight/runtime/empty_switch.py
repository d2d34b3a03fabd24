"""Takes the turn of a switch for somebody's word that nobody is in the cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from armsight.devices.data import SwitchState

OFF = 0.3
"""A switch has been off for at least so long before it is turned on [s] ..."""
ON = 0.2
"""... and is on for so long: a loose wire says nothing."""
GAP = 0.5
"""Where nothing was heard for longer, what it did meanwhile is not known [s]."""


class EmptySwitch:
    """A :class:`~armsight.runtime.sensing.SensorTap`.

    Only being turned on counts, never that it is on: one that hangs, or was on when the program
    began or the line came back, would say for ever what somebody has once seen.

    Args:
        say: called once for every turn.
    """

    def __init__(self, say: Callable[[], None]) -> None:
        self._say = say
        self._last: SwitchState | None = None
        self._since = 0.0
        self._ready = False

    def on_reading(self, reading: Any, now: float) -> None:
        """Heed the switch; all else passes."""
        if not isinstance(reading, SwitchState):
            return
        last, self._last = self._last, reading
        if last is None or not 0.0 <= reading.stamp - last.stamp <= GAP:
            self._since, self._ready = reading.stamp, False
            return
        held = reading.stamp - self._since
        if reading.on != last.on:
            self._ready = reading.on and last.stamp - self._since >= OFF
            self._since = reading.stamp
        elif reading.on and self._ready and held >= ON:
            self._ready = False
            self._say()
