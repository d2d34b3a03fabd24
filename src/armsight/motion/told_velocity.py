"""How well the velocity of a region is known that is told anew with every look at it."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.arrays import Vector3
from armsight.motion.regions import Region

LOOKS = 8
"""So many looks are remembered."""


class ToldVelocity:
    """The velocities that were told of a permitted region, by their exposures.

    What turns, or brakes, moves otherwise by now than when it was seen, and a filter believes that
    late. So nobody knows its velocity better than by how much it changed lately, in as long as the
    newest look is old.
    """

    def __init__(self) -> None:
        self._told: deque[tuple[float, Vector3]] = deque(maxlen=LOOKS)

    def forget(self) -> None:
        """Another region, or another clock."""
        self._told.clear()

    def take(self, region: Region) -> None:
        """What is told now; the same look says nothing new."""
        if not self._told or region.exposure > self._told[-1][0]:
            self._told.append((region.exposure, np.array(region.velocity, float)))

    def unsure(self, when: float) -> float:
        """By how much the velocity may be another at a time [s] than was told last [m/s]."""
        if not self._told:
            return 0.0
        exposure, velocity = self._told[-1]
        age = max(when - exposure, 0.0)
        changes = (
            min(1.0, age / (exposure - earlier)) * float(np.linalg.norm(velocity - told))
            for earlier, told in list(self._told)[:-1]
        )
        return max(changes, default=0.0)
