"""What an arm presses of somebody, told from who runs into an arm that stands."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np

from armsight.arrays import JointVector, Points
from armsight.motion.permits import Permit
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.simulation.truth import MOVING, Contact

STAYS = 0.3
"""After the touch a trial goes on for so long [s]."""
LOOKS = 5
"""Rounds from one look at the arm's distance from the person to the next."""


class Touched(Protocol):
    """An arm, and what it really touched.

    Attributes:
        robot: the arm; q: (n,) [rad] at ``now`` [s].
        contacts: of it so far.
    """

    robot: Robot
    q: JointVector
    now: float

    @property
    def contacts(self) -> list[Contact]:
        """See above."""
        ...


class Presses:
    """What the arm presses of somebody, and who runs into an arm that stands, which is no harm.

    Attributes:
        force: greatest of a contact that grew while the arm moved, or might touch [N].
        struck: greatest of any other: of who ran into an arm that stood [N].
        granted: greatest that was permitted [N].
        moves: some part of the arm moved lately.
    """

    def __init__(self) -> None:
        self.force = self.struck = self.granted = 0.0
        self.moves = False
        self._strongest = 0.0
        self._were: deque[tuple[float, Points]] = deque(maxlen=LOOKS + 1)

    @property
    def harm(self) -> bool:
        """Whether the arm pressed more than it ever might."""
        return self.force > max(self.granted, 1e-9)

    def look(self, cell: Touched, permit: Permit | None) -> None:
        """At the end of a round."""
        may = permit is not None and permit.holds
        self.granted = max(self.granted, permit.force) if permit and may else self.granted
        center = sphere_centers(cell.robot, cell.q)
        self._were.append((cell.now, center))
        since, were = self._were[0]
        way = float(np.linalg.norm(center - were, axis=1).max())
        self.moves = way > MOVING * (cell.now - since)
        strongest = max((c.force for c in cell.contacts if np.isfinite(c.force)), default=0.0)
        if strongest > self._strongest and (may or self.moves):
            self.force = strongest
        elif strongest > self._strongest:
            self.struck = strongest
        self._strongest = strongest
