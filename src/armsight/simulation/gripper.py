"""The simulated gripper: fingers that go to a width at their speed. It grasps nothing."""

from __future__ import annotations

import math

import numpy as np

from armsight.devices.data import GripperState
from armsight.devices.driven_hand import checked_width
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import GripperSpec


class SimulatedGripper:
    """Implements :class:`armsight.devices.protocols.Gripper`; open at the start."""

    def __init__(self, spec: GripperSpec, clock: SimulatedClock) -> None:
        self._spec = spec
        self._clock = clock
        self.reset()

    def reset(self) -> None:
        """Back to time 0: open."""
        self._start = (0.0, self._spec.opening)
        self._target = self._spec.opening
        self._told = -1

    @property
    def opening(self) -> float:
        """Greatest width [m]."""
        return self._spec.opening

    def move(self, width: float) -> None:
        """Begin to open or close to a width [m]; it begins after the gripper's delay.

        Raises:
            DeviceError: there is no such width.
        """
        width = checked_width(width, self.opening)
        now = self._clock.now()
        self._start = (now + self._spec.delay, self._width(now))
        self._target = width

    def read(self) -> GripperState | None:
        """The newest state since the last call, or None."""
        now = self._clock.now()
        count = math.floor(now * self._spec.rate + 1e-9)
        if count <= self._told:
            return None
        self._told = count
        width = self._width(now)
        return GripperState(now, width, abs(width - self._target) > 1e-9, holding=False)

    def _width(self, now: float) -> float:
        since, width = self._start
        most = self._spec.speed * max(0.0, now - since)
        return width + float(np.clip(self._target - width, -most, most))
