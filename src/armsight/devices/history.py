"""Where the joints were at a time in the past: interpolated, never extrapolated far."""

from __future__ import annotations

from collections import deque

from armsight.devices.data import JointState

TURNED_BACK = 0.5
"""A reading older than the last by more than this [s] is of a clock that was turned back."""


class JointHistory:
    """Remembers the last seconds of joint readings, in the order of their stamps."""

    def __init__(self, seconds: float = 2.0) -> None:
        self._seconds = seconds
        self._states: deque[JointState] = deque()

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
        return twin

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
            return JointState(stamp, nearest.position + gap * nearest.velocity, nearest.velocity)
        after = next(i for i in range(len(states) - 1, -1, -1) if states[i - 1].stamp <= stamp)
        a, b = states[after - 1], states[after]
        w = (stamp - a.stamp) / (b.stamp - a.stamp)
        return JointState(
            stamp,
            (1 - w) * a.position + w * b.position,
            (1 - w) * a.velocity + w * b.velocity,
        )
