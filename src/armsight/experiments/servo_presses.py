"""What an arm presses of somebody, told from who runs into an arm that stands."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np

from armsight.arrays import JointVector, Points
from armsight.experiments.servo_eyes import Path
from armsight.motion.permits import LIMITS, Permit
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.simulation.truth import MOVING, Contact

STAYS = 0.3
"""After the touch a trial goes on for so long [s]."""
TICK = 0.008
"""How fast something is led is taken over so long [s]."""
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


def led_speed(path: Path, now: float) -> float:
    """How fast what follows a path is led at a time [s], over the last 8 ms [m/s]."""
    return float(np.linalg.norm(path(now) - path(now - TICK))) / TICK


class Presses:
    """What the arm presses of somebody, and who runs into an arm that stands, which is no harm.

    The arm stands where it is touched as everywhere else: no faster than :data:`.MOVING` there,
    whatever its other parts do, for as long as that contact lasts; and it stands where the link
    that is touched did not move in the rounds before, though who runs into it pushes it away.

    Attributes:
        force: greatest of a contact that grew while a permit held, or with an arm that moved [N].
        struck: greatest of any other: of who ran into an arm that stood [N].
        granted: greatest that was permitted [N].
        moves: some part of the arm moved lately.
    """

    def __init__(self) -> None:
        self.force = self.struck = self.granted = 0.0
        self.moves = False
        self._felt: dict[int, float] = {}
        self._were: deque[tuple[float, Points]] = deque(maxlen=LOOKS + 1)

    @property
    def harm(self) -> bool:
        """Whether the arm pressed more than it ever might."""
        return self.force > max(self.granted, 1e-9)

    def look(self, cell: Touched, permit: Permit | None, comes: float = 0.0) -> None:
        """At the end of a round.

        Args:
            cell: arm and contacts.
            permit: the guard's newest answer.
            comes: how fast what may be touched is led [m/s]: a hand that is faster than one may be
                that is touched, and faster than the link it runs into, strikes that itself.
        """
        may = permit is not None and permit.holds
        self.granted = max(self.granted, permit.force) if permit and may else self.granted
        center = sphere_centers(cell.robot, cell.q)
        self._were.append((cell.now, center))
        since, were = self._were[0]
        speed = np.linalg.norm(center - were, axis=1) / max(cell.now - since, 1e-9)
        self.moves = bool((speed > MOVING).any())
        links = np.asarray(cell.robot.spheres.link)
        for k, contact in enumerate(cell.contacts):
            if not contact.force > self._felt.get(k, 0.0):
                continue
            self._felt[k] = contact.force
            own = float(speed[links == contact.link].max(initial=0.0))
            struck = comes > max(own, LIMITS["hand"].region_speed)
            if not struck and (may or (contact.moving and own > MOVING)):
                self.force = max(self.force, contact.force)
            else:
                self.struck = max(self.struck, contact.force)
