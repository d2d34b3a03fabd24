"""The cable of a tool between it and the hanger: its measures, and where it is while it swings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Points, Vector3
from armsight.robots.cable_kernels import hang, swing

PIECES = 16
"""Of the chain that a cable counts as."""
DAMPING = 0.006
"""What resists a change of its bending [N m^2 s]: a guess, as everybody's."""
LOST = 0.5
"""Whose end nobody knew for longer than this [s] hangs still where it is seen again."""
ROOT = (0.0, -0.02, -0.12)
"""Where a cable leaves a plug, in the frame of its tip [m]."""


@dataclass(frozen=True)
class HungCable:
    """A heavy cable from a tool to a hanger.

    Attributes:
        hanger: (3,) where it is hung up, in ``base`` [m].
        length: from the tool to there [m]; radius: [m].
        root: (3,) where it leaves the tool, in the frame of its tip [m].
        mass: of a metre [kg/m]; bending: what resists bending [N m^2].
    """

    hanger: tuple[float, float, float]
    length: float
    radius: float = 0.016
    root: tuple[float, float, float] = ROOT
    mass: float = 2.26
    bending: float = 0.3

    def still(self, end: Vector3, count: int = PIECES + 1) -> Points:
        """(count, 3) points of it from its end at ``end`` (3,) to the hanger, in ``base`` [m]."""
        out = np.empty((count, 3))
        hang(np.asarray(end, float), np.array(self.hanger, float), self.length, out)
        return out


class SwingingCable:
    """Follows a cable whose end is led: it lags, swings and comes to rest.

    Attributes:
        place: (PIECES + 1, 3) points of it, equally far apart, its end first [m]; velocity: theirs
            [m/s]. Nothing until its end is known.
    """

    def __init__(self, cable: HungCable) -> None:
        self._cable = cable
        self._when = -np.inf
        self.place: Points = np.full((PIECES + 1, 3), np.nan)
        self.velocity: Points = np.zeros((PIECES + 1, 3))

    def follow(self, end: Vector3, when: float) -> None:
        """Its end is at ``end`` (3,) [m] at a time [s].

        What was before, by less than :data:`LOST`, changes nothing: pictures come out of order.
        """
        cable, passed = self._cable, when - self._when
        if abs(passed) > LOST or not np.isfinite(passed):
            self.place, self.velocity = cable.still(end), np.zeros((PIECES + 1, 3))
            self._when = when
        elif passed > 0.0:
            to = np.ascontiguousarray(end, float)
            swing(
                self.place, self.velocity, to, passed, cable.length, cable.mass, cable.bending,
                DAMPING,
            )  # fmt: skip
            self._when = when
