"""Where joints were at a time in the past, never extrapolated far, and what the tool felt."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.arrays import Floats
from armsight.devices.data import JointState, Wrench

TURNED_BACK = 0.5
"""A reading older than the last by more than this [s] is of a clock that was turned back."""
FELT = 0.015
"""What a force sensor says so shortly before and after a time is of that time [s]."""


class JointHistory:
    """Remembers the last seconds of joint and force readings, in the order of their stamps."""

    def __init__(self, seconds: float = 2.0) -> None:
        self._seconds = seconds
        self._states: deque[JointState] = deque()
        self._felt: deque[tuple[float, Floats]] = deque()

    def add(self, state: JointState) -> None:
        """Remember a reading.

        One that is not newer than the last is ignored; but one that is much older means that the
        clock was turned back: then the others are of a time that is still to come, and forgotten.
        """
        if self._states and state.stamp < self._states[-1].stamp - TURNED_BACK:
            self._states.clear()
        if self._states and state.stamp <= self._states[-1].stamp:
            return
        self._states.append(state)
        while self._states[0].stamp < state.stamp - self._seconds:
            self._states.popleft()

    def copy(self) -> JointHistory:
        """The readings so far, for somebody who works on while more come in."""
        twin = JointHistory(self._seconds)
        twin._states = self._states.copy()
        twin._felt = self._felt.copy()
        return twin

    def feel(self, wrench: Wrench) -> None:
        """Remember a reading of the force sensor; one that is no number is ignored."""
        value = np.concatenate([wrench.force, wrench.torque]).astype(float)
        if not (np.isfinite(value).all() and np.isfinite(wrench.stamp)):
            return
        felt = self._felt
        if felt and wrench.stamp < felt[-1][0] - TURNED_BACK:
            felt.clear()
        if felt and wrench.stamp <= felt[-1][0]:
            return
        felt.append((wrench.stamp, value))
        while felt[0][0] < wrench.stamp - self._seconds:
            felt.popleft()

    def felt(self, stamp: float) -> Floats | None:
        """(6,) what the force sensor said about a time [s]: the mean of :data:`FELT`.

        None where it said nothing then: nobody knows what acted on the tool.
        """
        about = [value for at, value in self._felt if abs(at - stamp) <= FELT]
        return np.asarray(np.mean(about, axis=0)) if about else None

    @property
    def latest(self) -> JointState | None:
        """The newest reading, or None."""
        return self._states[-1] if self._states else None

    def at(self, stamp: float, tolerance: float = 0.05) -> JointState | None:
        """Joints at a time [s], linear between readings; None more than ``tolerance`` outside them.

        Just outside the known time the nearest reading's velocity carries the position on.
        """
        if not self._states:
            return None
        states = self._states
        if stamp <= states[0].stamp or stamp >= states[-1].stamp:
            nearest = states[0] if stamp <= states[0].stamp else states[-1]
            gap = stamp - nearest.stamp
            if abs(gap) > tolerance:
                return None
            velocity = nearest.velocity.copy()
            return JointState(stamp, nearest.position + gap * velocity, velocity)
        after = next(i for i in range(len(states) - 1, -1, -1) if states[i - 1].stamp <= stamp)
        a, b = states[after - 1], states[after]
        w = (stamp - a.stamp) / (b.stamp - a.stamp)
        return JointState(
            stamp,
            (1 - w) * a.position + w * b.position,
            (1 - w) * a.velocity + w * b.velocity,
        )
