"""Out of the cameras' way, where nothing is seen: the arm itself may hide its target.

An arm that begins before its target, or was stopped there, can hide it from every camera that
could see it, while its own pair looks past it. It goes home then, along the planner's way, and
looks on from there.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import JointVector
from armsight.motion.intents import JointIntent

WAITS = 2.0
"""Nothing was seen for so long [s]."""
THERE = 0.05
"""The arm is at home when every joint is this near [rad]."""


class Lookout:
    """Whether the arm goes to look from elsewhere.

    Args:
        home: (n,) where it hides least [rad].
    """

    def __init__(self, home: JointVector) -> None:
        self._home = np.array(home, float)
        self.reset()

    def reset(self) -> None:
        """It has just begun to look."""
        self._since = math.inf

    def update(self, now: float, q: JointVector) -> JointIntent | None:
        """One round in which nothing is seen at (n,) [rad]; where to go, or None to stay.

        Who sees something again says so by :meth:`reset`.
        """
        self._since = min(self._since, now)
        if now < self._since + WAITS or float(np.abs(q - self._home).max()) < THERE:
            return None
        return JointIntent("nothing seen: looks from home", self._home)
