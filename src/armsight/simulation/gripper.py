"""The simulated gripper: fingers that go to a width at their speed, and hold what is between."""

from __future__ import annotations

import math

import numpy as np

from armsight.devices.data import GripperState
from armsight.devices.driven_hand import checked_width
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import GripperSpec

APART = 0.002
"""Fingers that stand still farther from where they should be than this hold something [m]."""
STILL = 0.004
"""Slower fingers stand still [m/s]."""


class SimulatedGripper:
    """Implements :class:`armsight.devices.protocols.Gripper`; open at the start.

    In a cell where contact pushes its fingers are bodies, and it says what those do; elsewhere it
    grasps nothing.
    """

    def __init__(self, spec: GripperSpec, clock: SimulatedClock) -> None:
        self._spec = spec
        self._clock = clock
        self.reset()

    def reset(self) -> None:
        """Back to time 0: open."""
        self.stand(self._spec.opening)
        self._told = -1
        self._felt: tuple[float, float] | None = None

    @property
    def stands(self) -> float:
        """Where its drive would have the width now [m]."""
        return self.wanted(self._clock.now())

    def stand(self, width: float) -> None:
        """It stands at a width [m], as one does whose program has ended."""
        self._start, self._target = (0.0, width), width

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
        self._start = (now + self._spec.delay, self.wanted(now))
        self._target = width

    def read(self) -> GripperState | None:
        """The newest state since the last call, or None."""
        now = self._clock.now()
        count = math.floor(now * self._spec.rate + 1e-9)
        if count <= self._told:
            return None
        self._told = count
        wanted = self.wanted(now)
        going = abs(wanted - self._target) > 1e-9
        if self._felt is None:
            return GripperState(now, wanted, going, holding=False)
        width, speed = self._felt
        moving = speed > STILL
        held = not moving and not going and width > self._target + APART
        return GripperState(now, width, moving, holding=held)

    def wanted(self, now: float) -> float:
        """Where its drive would have the width at a time [m]."""
        since, width = self._start
        most = self._spec.speed * max(0.0, now - since)
        return width + float(np.clip(self._target - width, -most, most))

    def feel(self, closed: float, speed: float) -> None:
        """Take in how far each finger has closed [m], and how fast it moves [m/s]."""
        self._felt = (self._spec.opening - 2.0 * closed, 2.0 * abs(speed))
