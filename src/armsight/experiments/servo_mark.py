"""Where a tip comes to a bulls-eye: what judges ``servo-bullseye``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.experiments.servo_onlooker import Seen
from armsight.experiments.servo_presses import Presses
from armsight.motion.permits import Permit

REACHED, MARKED, SETTLES = 0.005, 0.001, 0.4
"""V: the tip came within 5 mm. It marks the plate within 1 mm, or where it is this much later
[m], [m], [s]."""


class Mark:
    """Where the tip comes to the plate.

    Args:
        T: (4, 4) the bulls-eye in ``base``, z out of it.

    Attributes:
        at: (2,) from the centre [m]; None before it is made.
    """

    def __init__(self, T: Pose) -> None:
        self.at: Floats | None = None
        self._T, self._near = T, math.inf

    @property
    def made(self) -> bool:
        """Whether there is one."""
        return self.at is not None

    def height(self, tip: Vector3) -> float:
        """How far (3,) the tip is before the plate [m]; inf beside it."""
        away = tip - self._T[:3, 3]
        height = float(away @ self._T[:3, 2])
        beside = float(np.linalg.norm(away - height * self._T[:3, 2]))
        return height if beside < 0.1 else math.inf

    def follow(self, now: float, tip: Vector3) -> None:
        """(3,) where the tip truly came to in the round that began at a time."""
        height = self.height(tip)
        if height < REACHED:
            self._near = min(self._near, now)
        if height < MARKED or now > self._near + SETTLES:
            self.at = np.asarray(self._T[:3, :2].T @ (tip - self._T[:3, 3]))

    def found(self) -> dict[str, Any]:
        """Where it is, as JSON values [mm]."""
        return {
            "mm": 200.0 if self.at is None else float(1e3 * np.linalg.norm(self.at)),
            "mark": None if self.at is None else [float(1e3 * m) for m in self.at],
        }


class Marking:
    """Judges a rendered trial, see :class:`~.servo_onlooker.Judge`: its mark, and what it presses.

    Args:
        T: as of :class:`Mark`; limit: the trial ends then in any case [s].

    Attributes:
        mark: see there; presses: what the arm pressed; seconds: after which it ended [s].
    """

    def __init__(self, T: Pose, limit: float) -> None:
        self.mark, self.presses, self.seconds, self.over = Mark(T), Presses(), limit, False

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """At the end of a round."""
        self.presses.look(seen, permit)
        if seen.now >= seen.begins and not self.over:
            self.mark.follow(seen.now, seen.tip())
            self.over, self.seconds = self.mark.made, seen.now - seen.begins
