"""The last half minute of what the plots show, in buffers that never grow."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats

SECONDS = 30.0
RATE = 10.0
"""Samples a second of the clock [Hz]."""


class History:
    """Samples of a few values over time; the oldest go."""

    def __init__(self, columns: int) -> None:
        self._rows = np.zeros((0, 1 + columns))
        self._columns = columns

    def add(self, now: float, *values: float) -> bool:
        """Remember values at a time [s]; false if it is too soon after the last ones."""
        if len(self._rows):
            last = self._rows[-1, 0]
            if now < last - 1e-6:  # the session was reset
                self.clear()
            elif now < last + 0.9 / RATE:
                return False
        row = np.array([[now, *values]])
        keep = self._rows[self._rows[:, 0] > now - SECONDS]
        self._rows = np.concatenate([keep[-int(SECONDS * RATE) :], row])
        return True

    def clear(self) -> None:
        """Forget everything."""
        self._rows = np.zeros((0, 1 + self._columns))

    def columns(self) -> tuple[Floats, ...]:
        """Time, relative to the newest sample [s], and each value; at least two samples long."""
        rows = self._rows
        if len(rows) < 2:
            row = rows[0, 1:] if len(rows) else np.full(self._columns, np.nan)
            rows = np.array([[-SECONDS, *row], [0.0, *row]])
        return tuple(np.ascontiguousarray(c) for c in (rows[:, 0] - rows[-1, 0], *rows[:, 1:].T))
