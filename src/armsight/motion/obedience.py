"""Whether the arm does what it is told: its readings against where its commands lead.

Readings that stand still under fresh stamps, drives that do not follow, and drives that go on when
told to stop look alike from here, and in all of them nobody knows where the arm is going.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import JointState
from armsight.motion.arm_model import DelayedArm

WINDOW = 0.25
"""A reading is compared with what one so much older, and the commands since, lead to [s]."""
SLACK = 0.025
"""They may differ by this [rad] ..."""
SHARE = 0.3
"""... and by this share of the way that was told or made, whichever is longer: delays and ramps
are not known better."""
HELD = 5.0
"""An arm that disobeyed stands for so long before it may try again [s]."""


class Obedience:
    """Compares readings with commands.

    Drives may answer sooner than declared: what a reading says is compared with all that lies
    between the answers of drives that take no time, half of the declared one, and all of it.

    Args:
        arms: models of the drives, for this watch alone, of different delays, the likeliest first.
        names: (n) of the joints.
    """

    def __init__(self, arms: Sequence[DelayedArm], names: tuple[str, ...]) -> None:
        self._arms = tuple(arms)
        self._names = names
        self._readings: deque[JointState] = deque()
        self._until = -np.inf
        self._reason = ""

    def sent(self, now: float, velocity: JointVector, brake: bool) -> None:
        """A command (or a stop) was sent at ``now`` [s]."""
        for arm in self._arms:
            arm.sent(now, velocity, brake)

    def forget(self) -> None:
        """Time was lost: neither commands nor readings before it say anything."""
        for arm in self._arms:
            arm.forget()
        self._readings.clear()
        self._until = -np.inf

    def fault(self, now: float, joints: JointState) -> str:
        """Why the arm cannot be commanded at ``now`` [s], or nothing.

        Args:
            now: [s].
            joints: a reading that is well-formed.
        """
        self._note(now, joints)
        return self._reason if now < self._until else ""

    def _note(self, now: float, joints: JointState) -> None:
        readings = self._readings
        if readings and joints.stamp <= readings[-1].stamp:
            return
        readings.append(joints)
        while len(readings) > 1 and readings[1].stamp <= joints.stamp - WINDOW:
            readings.popleft()
        first = readings[0]
        if joints.stamp - first.stamp < WINDOW:
            return
        made = np.asarray(joints.position, float) - first.position
        ways = [self._way(self._arms[0], first, joints)]
        if _over(ways[0], made).max() <= 0.0:
            return  # what lies between this and other ways is no farther away
        ways += [self._way(arm, first, joints) for arm in self._arms[1:]]
        told = np.clip(made, np.min(ways, axis=0), np.max(ways, axis=0))
        over = _over(told, made)
        j = int(np.argmax(over))
        if over[j] > 0.0:
            self._until = now + HELD
            self._reason = (
                f"{self._names[j]} does not follow: told to go {np.rad2deg(told[j]):.1f} deg in "
                f"{joints.stamp - first.stamp:.2f} s, it says {np.rad2deg(made[j]):.1f}; "
                "check the arm"
            )

    @staticmethod
    def _way(arm: DelayedArm, first: JointState, last: JointState) -> JointVector:
        """(n,) how far the commands lead from one reading to the time of another [rad]."""
        return np.asarray(arm.ahead(first, last.stamp).position - first.position)


def _over(told: JointVector, made: JointVector) -> JointVector:
    """(n,) by how much more than they may the two differ [rad]."""
    room = SLACK + SHARE * np.maximum(np.abs(told), np.abs(made))
    return np.asarray(np.abs(told - made) - room)
