"""Remembers what was said last, so that only news is said, and not too often."""

from __future__ import annotations

import math


class Changes:
    """By key: what was last, and when."""

    def __init__(self) -> None:
        self._last: dict[str, object] = {}
        self._when: dict[str, float] = {}

    def changed(self, key: str, value: object) -> bool:
        """Whether this is another object than last time; numbers and tuples count by value."""
        before = self._last.get(key, self)
        self._last[key] = value
        return before != value if isinstance(value, int | tuple) else before is not value

    def due(self, key: str, now: float, period: float) -> bool:
        """Whether a period [s] has passed since this last was true."""
        if now < self._when.get(key, -math.inf) + period - 1e-9:
            return False
        self._when[key] = now
        return True
