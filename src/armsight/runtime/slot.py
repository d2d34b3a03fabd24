"""How components hand each other immutable values: the newest wins, a reader never waits."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

LONGEST = 10.0
"""Whatever is handed over can be seen after this time [s]: what it has replaced is forgotten then,
where nobody reads."""


class Slot(Generic[T]):
    """Holds the newest published value.

    Under the simulated clock a value becomes visible only once its maker's (declared or measured)
    latency has passed, so a slow planner is slow in simulation as well. Under the wall clock
    ``visible_at`` is simply now.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pending: deque[tuple[float, T]] = deque()
        self._value: T | None = None

    def publish(self, value: T, visible_at: float) -> None:
        """Hand over a value that readers may see from ``visible_at`` [s] on."""
        with self._lock:
            self._pending.append((visible_at, value))
            while len(self._pending) > 1 and self._pending[1][0] <= visible_at - LONGEST:
                self._value = self._pending.popleft()[1]

    def read(self, now: float) -> T | None:
        """The newest value visible at ``now`` [s], or None before the first."""
        with self._lock:
            while self._pending and self._pending[0][0] <= now:
                self._value = self._pending.popleft()[1]
            return self._value
