"""How a component of the loop is doing: rounds, missed deadlines, compute time."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np

from armsight.runtime.view import ComponentHealth

RECENT = 512
"""Rounds over which compute times are summarised."""


class HealthMeter:
    """Counts the rounds of one component; written by its thread, read by any."""

    def __init__(self, name: str, period: float) -> None:
        self.name = name
        self.period = period
        self._lock = threading.Lock()
        self._seconds: deque[float] = deque(maxlen=RECENT)
        self._rounds = 0
        self._missed = 0
        self._last = float("-inf")
        self._problem = ""

    def round(self, now: float, seconds: float) -> None:
        """One round was done at ``now`` [s] and took ``seconds`` of computing [s]."""
        with self._lock:
            self._rounds += 1
            self._last = now
            self._seconds.append(seconds)

    def more(self, seconds: float) -> None:
        """The last round computed this much longer, beside the loop [s]."""
        with self._lock:
            self._seconds[-1] += seconds

    def missed(self, count: int = 1) -> None:
        """Deadlines passed without a round."""
        with self._lock:
            self._missed += count

    def problem(self, text: str) -> None:
        """Say what is wrong; an empty text says that all is well again."""
        with self._lock:
            self._problem = text

    @property
    def last(self) -> float:
        """When the last round was done [s]; -inf before the first."""
        with self._lock:
            return self._last

    def report(self) -> ComponentHealth:
        """The figures so far."""
        with self._lock:
            seconds = np.array(self._seconds) if self._seconds else np.zeros(1)
            return ComponentHealth(
                self.name,
                self.period,
                self._rounds,
                self._missed,
                self._last,
                (float(np.median(seconds)), float(np.percentile(seconds, 99))),
                self._problem,
            )
