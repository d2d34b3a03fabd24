"""How far a target strays from what was predicted of it, as its later sightings show.

The arm acts a sixth of a second after an exposure. What shakes, or turns, has gone elsewhere by
then, and a tip that stays at its surface is pressed: it stays off by about what predictions were
wrong by lately, is brought to touch by the very errors, and leaves at once. What was swung about
and pauses is not believed to be calm so soon.
"""

from __future__ import annotations

import math
from collections import deque

from armsight.arrays import Vector3
from armsight.servoing.estimate import TargetEstimate

FADES, WILD = 0.6, 2.0
"""An error of a prediction is remembered for about this long [s]; one so great that no standing off
is enough for longer: hands pause for a second or two between two swings."""
KNOWN = 0.5
"""Until so long after the first prediction nobody knows yet how the target moves [s]."""
KEPT = 64
"""Predictions that wait for what they were of to be seen."""
TOUCHED = 0.003
"""So near to its surface the tip has touched it [m]."""
WARY, OFF, MOVES = 1.25, 0.03, 0.1
"""It stays off by so many errors, by this much at most [m], and no more than the target moves in
this time [s]: errors as great bring it to touch from there, too, when they are greatest, where
tip and target stand to each other. Until November 2026 it stayed off by 5 mm at most."""
TURNS = 2.5
"""What goes its way turns off it, as hands do, with so much of its speed a second [1/s]."""
GOES = 0.02
"""What is slower stands: where its place was found wrong, it does not come [m/s]."""
LEAVES, BY = 0.8, 0.03
"""It leaves for so long [s], by so much [m]."""


class Straying:
    """Compares predictions with what was seen later.

    Args:
        reserve: so wrong a prediction may be without harm [m]; inf for any.

    Attributes:
        error: the greatest of the last, along the tool, fading [m].
        speed: the greatest of the last of the target, fading [m/s].
    """

    def __init__(self, reserve: float) -> None:
        self.error = self.speed = self._wild = 0.0
        self._reserve = reserve
        self._waiting: deque[tuple[float, Vector3]] = deque(maxlen=KEPT)
        self._told = self._touched = -math.inf
        self._known = math.inf

    def predicted(self, time: float, place: Vector3) -> None:
        """A place (3,) [m] was predicted for a time [s]; times come in order."""
        self._known = min(self._known, time + KNOWN)
        self._waiting.append((time, place))

    def seen(self, estimate: TargetEstimate, axis: Vector3) -> None:
        """What is known now: predictions of what has been seen since are judged.

        Only along (3,) the tool's axis: beside it an error brings a tip no nearer to a ball.
        """
        if estimate.seen <= self._told:
            return
        fades = math.exp(-(estimate.seen - self._told) / FADES)
        self._wild *= math.exp(-(estimate.seen - self._told) / WILD)
        self.error = max(self.error * fades, self._wild)
        self._told = estimate.seen
        speed = math.sqrt(float(estimate.velocity @ estimate.velocity))
        self.speed = max(speed, self.speed * fades)
        newest = None
        while self._waiting and self._waiting[0][0] <= estimate.stamp:
            newest = self._waiting.popleft()
        if newest is None:
            return
        time, place = newest
        off = place + (estimate.stamp - time) * estimate.velocity - estimate.position
        error = abs(float(off @ axis))
        self.error = max(self.error, error)
        if error > max(self._reserve, OFF) and time > self._known:
            self._wild = max(self._wild, error)

    def turns(self, ahead: float) -> float:
        """Acceleration [m/s^2] that predictions over a time [s] lately did not know of."""
        return max(2.0 * self.error / max(ahead, 0.1) ** 2, TURNS * self.speed)

    def speed_error(self, ahead: float) -> float:
        """By how much the speed [m/s] of predictions over a time [s] was wrong lately."""
        return 2.0 * self.error / max(ahead, 0.1)

    def keeps_off(self, now: float, distance: float) -> float:
        """How far before the surface the tip shall stay now [m], whose distance is believed [m]."""
        if self.error > self._reserve and self.speed > GOES and distance < TOUCHED:
            self._touched = now
        if now < self._touched + LEAVES:
            return BY
        return min(max(WARY * self.error - self._reserve, 0.0), OFF, MOVES * self.speed)
