"""The simulated clock: time moves only when the world is advanced."""

from __future__ import annotations


class SimulatedClock:
    """Seconds since the world's start."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Present simulated time [s]."""
        return self._now

    def _set(self, now: float) -> None:
        self._now = now
