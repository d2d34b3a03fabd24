"""A target that stays out of reach, or refused, is given up after a stated time, with the reason.

The arm waits for what may change (somebody beside the target, a hand that is too fast, a thing in
its way), but not for ever without a word: then it rests where it is and asks no more, until the
target is elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Vector3
from armsight.motion.permits import Permit

STATED = 30.0
"""A permit, or a way, is waited for so long [s], unless a task is told another time."""
ELSEWHERE = 0.1
"""What has moved by this much since it was given up is asked for anew [m]."""
PAUSE = 0.5
"""One that is not asked for within this time [s] is waited for no longer."""


class Patience:
    """How long a target could not be come to.

    Args:
        seconds: it is given up after this [s]; inf for never.

    Attributes:
        gave_up: why, in words; empty while nothing was given up.
    """

    def __init__(self, seconds: float = STATED) -> None:
        self.seconds = seconds
        self.reset()

    def reset(self) -> None:
        """Nothing has been waited for."""
        self.gave_up = ""
        self._since, self._refused = math.inf, -math.inf
        self._place: Vector3 | None = None

    def update(
        self, now: float, permit: Permit | None, place: Vector3 | None, hindered: str = ""
    ) -> str:
        """Why the target is given up, in words; empty while it is not.

        Args:
            now: time [s].
            permit: the guard's newest answer; None where nothing was asked.
            place: (3,) where the target is [m]; None where nobody knows.
            hindered: what else keeps the arm from it, in words; empty where nothing does.
        """
        if self.gave_up:
            if place is None or self._place is None or _apart(place, self._place) > ELSEWHERE:
                self.reset()
            return self.gave_up
        refused = "" if permit is None or permit.holds else str(permit)
        if refused or hindered:
            self._since, self._refused = min(self._since, now), now
            if now > self._since + self.seconds and place is not None:
                self._place = np.array(place)
                self.gave_up = f"gave up after {self.seconds:g} s: " + "; ".join(
                    words for words in (hindered, refused) if words
                )
        elif permit is not None or now > self._refused + PAUSE:
            self._since = math.inf
        return self.gave_up


def _apart(a: Vector3, b: Vector3) -> float:
    return float(np.linalg.norm(a - b))
