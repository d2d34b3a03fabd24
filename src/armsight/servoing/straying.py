"""How far a target strays from what was predicted of it, as its later sightings show.

The arm acts a sixth of a second after an exposure. What shakes, or turns, has gone elsewhere by
then, and a tip that stays at its surface is pressed: it comes to a few millimetres before it, is
brought to touch it by the very errors, and leaves at once.
"""

from __future__ import annotations

import math
from collections import deque

from armsight.arrays import Vector3
from armsight.servoing.estimate import TargetEstimate

FADES = 0.6
"""An error of a prediction is remembered for about this long [s]."""
KEPT = 64
"""Predictions that wait for what they were of to be seen."""
TOUCHED = 0.003
"""So near to its surface the tip has touched it [m]."""
OFF, MOVES = 0.005, 0.05
"""It stays off by this much at most [m], and no more than the target moves in this time [s]: errors
as great bring it to touch from there, too, and press it less."""
LEAVES, BY = 0.8, 0.03
"""It leaves for so long [s], by so much [m]."""


class Straying:
    """Compares predictions with what was seen later.

    Args:
        reserve: so wrong a prediction may be without harm [m]; inf for any.

    Attributes:
        error: the greatest of the last, fading [m].
    """

    def __init__(self, reserve: float) -> None:
        self.error = 0.0
        self._reserve = reserve
        self._waiting: deque[tuple[float, Vector3]] = deque(maxlen=KEPT)
        self._told = self._touched = -math.inf
        self._speed = 0.0

    def predicted(self, time: float, place: Vector3) -> None:
        """A place (3,) [m] was predicted for a time [s]; times come in order."""
        self._waiting.append((time, place))

    def seen(self, estimate: TargetEstimate) -> None:
        """What is known now: predictions of what has been seen since are judged."""
        if estimate.seen <= self._told:
            return
        self.error *= math.exp(-(estimate.seen - self._told) / FADES)
        self._told = estimate.seen
        self._speed = math.sqrt(float(estimate.velocity @ estimate.velocity))
        newest = None
        while self._waiting and self._waiting[0][0] <= estimate.stamp:
            newest = self._waiting.popleft()
        if newest is None:
            return
        time, place = newest
        off = place + (estimate.stamp - time) * estimate.velocity - estimate.position
        self.error = max(self.error, math.sqrt(float(off @ off)))

    def keeps_off(self, now: float, distance: float) -> float:
        """How far before the surface the tip shall stay now [m], whose distance is believed [m]."""
        if self.error > self._reserve and distance < TOUCHED:
            self._touched = now
        if now < self._touched + LEAVES:
            return BY
        return min(max(self.error - 2.0 * self._reserve, 0.0), OFF, MOVES * self._speed)
