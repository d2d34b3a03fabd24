"""Whether the arm does what it is told: its readings against where its commands lead.

Readings that stand still under fresh stamps, drives that do not follow, and drives that go on when
told to stop look alike from here, and in all of them nobody knows where the arm is going. Nor does
anybody where it is when a joint is elsewhere from one reading to the next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.devices.data import JointState
from armsight.motion.arm_model import DelayedArm
from armsight.motion.dead_reckoning import DeadReckoning

WINDOW = 0.25
"""A reading is compared with what one so much older, and the commands since, lead to [s]."""
SLACK = np.array([[0.025], [0.1]])
"""Ways may differ by the first [rad], speeds at the end by the second [rad/s] ..."""
SHARE = np.array([[0.3], [0.5]])
"""... and by these shares of what was told or made, whichever is more: delays and ramps are not
known better."""
UNLIKE_FOR = 0.06
"""Speeds have to differ for so long [s]: of a fast joint they tell sooner than its way does."""
STEP, TIMING = 0.01, 0.01
"""From one reading to the next a joint goes as its own two speeds say, but for this [rad], for
stamps that are off by so much [s], and for what its drive's ramp bends."""
HELD = 5.0
"""An arm that disobeyed, or whose readings stepped, stands for so long before it may try again [s]:
nobody knows which of two readings was right."""


class Obedience:
    """Compares readings with commands.

    Drives may answer sooner than declared: what a reading says is compared with all that lies
    between the answers of drives that take no time, half of the declared one, and all of it.

    Args:
        arms: models of the drives, for this watch alone, of different delays, the likeliest first.
        names: (n) of the joints.
        reckoning: what watches for readings that creep away.
    """

    def __init__(
        self, arms: Sequence[DelayedArm], names: tuple[str, ...], reckoning: DeadReckoning
    ) -> None:
        self._arms = tuple(arms)
        self._reckoning = reckoning
        self._names = names
        self._readings: deque[JointState] = deque()
        self._until = -np.inf
        self._reason = ""
        self._unlike = np.inf

    def sent(self, now: float, velocity: JointVector, brake: bool) -> None:
        """A command (or a stop) was sent at ``now`` [s]."""
        for arm in self._arms:
            arm.sent(now, velocity, brake)
        self._reckoning.sent(now, velocity, brake)

    def forget(self) -> None:
        """Time was lost: neither commands nor readings before it say anything."""
        for arm in self._arms:
            arm.forget()
        self._reckoning.forget()
        self._readings.clear()
        self._until, self._unlike = -np.inf, np.inf

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
        crept = self._reckoning.fault(joints)
        if crept:
            self._say(now, crept)
        if readings and self._stepped(now, readings[-1], joints):
            readings.clear()  # from one side of a step to the other nothing leads
        readings.append(joints)
        while len(readings) > 1 and readings[1].stamp <= joints.stamp - WINDOW:
            readings.popleft()
        first = readings[0]
        if joints.stamp - first.stamp < WINDOW:
            return
        made = np.stack([np.asarray(joints.position) - first.position, joints.velocity])
        ways = [self._led(self._arms[0], first, joints)]
        over = _over(ways[0], made)
        if over.max() > 0.0:  # what lies between this and other ways is no farther away
            ways += [self._led(arm, first, joints) for arm in self._arms[1:]]
            ways[0] = np.clip(made, np.min(ways, axis=0), np.max(ways, axis=0))
            over = _over(ways[0], made)
        (told, speed), (went, fast) = ways[0], made
        j = int(np.argmax(over[0]))
        k = int(np.argmax(over[1]))
        self._unlike = min(self._unlike, joints.stamp) if over[1, k] > 0.0 else np.inf
        if over[0, j] > 0.0:
            self._say(
                now,
                f"{self._names[j]} does not follow: told to go {np.rad2deg(told[j]):.1f} deg in "
                f"{joints.stamp - first.stamp:.2f} s, it says {np.rad2deg(went[j]):.1f}; "
                "check the arm",
            )
        elif joints.stamp - self._unlike >= UNLIKE_FOR:
            self._say(
                now,
                f"{self._names[k]} does not follow: told to go at {np.rad2deg(speed[k]):.0f} "
                f"deg/s, it says {np.rad2deg(fast[k]):.0f}; check the arm",
            )

    def _say(self, now: float, reason: str) -> None:
        self._until, self._reason = now + HELD, reason

    def _stepped(self, now: float, last: JointState, joints: JointState) -> bool:
        """Whether a joint is elsewhere than it can have gone to since the last reading."""
        elapsed = joints.stamp - last.stamp
        went = 0.5 * elapsed * (np.asarray(last.velocity) + joints.velocity)
        step = np.asarray(joints.position) - last.position - went
        over = np.abs(step) - STEP - TIMING * np.abs(joints.velocity)
        over -= 0.5 * elapsed * elapsed * self._arms[0].brake
        j = int(np.argmax(over))
        if over[j] > 0.0:
            self._say(
                now,
                f"{self._names[j]} jumped by {np.rad2deg(step[j]):.1f} deg, and says that it did "
                "not move so; check its encoder",
            )
        return bool(over[j] > 0.0)

    @staticmethod
    def _led(arm: DelayedArm, first: JointState, last: JointState) -> Floats:
        """(2, n) how far commands lead from one reading to another [rad], how fast then [rad/s]."""
        state = arm.ahead(first, last.stamp)
        return np.stack([state.position - first.position, state.velocity])


def _over(told: Floats, made: Floats) -> Floats:
    """(2, n) by how much more than they may two ways [rad] and two speeds [rad/s] differ."""
    room = SLACK + SHARE * np.maximum(np.abs(told), np.abs(made))
    return np.asarray(np.abs(told - made) - room)
