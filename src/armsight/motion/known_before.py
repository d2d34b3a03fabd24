"""An arm that stood in contact when its guard began: a program that was killed, and started again.

Nothing tells such a guard the press from the sensor's error. Who asks to touch may know it: what
the sensor said before the contact was written down by the program that was killed. It is believed
of a thing alone, where nobody is, and only while the arm has not moved since the guard began.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.motion.nearest import MovingBody
from armsight.motion.permits import PermitRequest, touching
from armsight.motion.permitted import Grant
from armsight.motion.retreat import CLEAR, gap
from armsight.robots.robot import Robot

STOOD = 0.01
"""An arm whose joints are all as near to where they were [rad] has not moved."""


class KnownBefore:
    """Remembers whether an arm has moved since its guard began.

    Args:
        robot: with its tool; body: its moving parts.
    """

    def __init__(self, robot: Robot, body: MovingBody) -> None:
        self._robot, self._body = robot, body
        self._first: JointVector | None = None
        self._moved = False

    def take(self, q: JointVector) -> None:
        """Where the arm is now, (n,) [rad]."""
        if self._first is None:
            self._first = np.array(q)
        self._moved = self._moved or bool(np.abs(q - self._first).max() > STOOD)

    def tare(self, request: PermitRequest, now: float) -> Floats | None:
        """(6,) what the sensor said before the contact [N], [N m]; None where nobody knows.

        Args:
            request: well-formed.
            now: [s].
        """
        if request.kind != "thing" or request.tare is None or self._moved or self._first is None:
            return None
        grant = Grant(request.region, touching(self._robot, request))
        touches = gap(self._body, grant, self._first, now) < CLEAR
        return np.asarray(request.tare, float) if touches else None
