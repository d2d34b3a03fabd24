"""The computer's clock as the workcell's time. The simulated clock lives with its world."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class WallClock:
    """Seconds since this clock was made; monotonic, so it never runs backwards.

    It can be paused and restarted for simulated and recorded cells that run in threads; a real cell
    never pauses its clock.

    Args:
        start: what it says at first [s].
        source: counts seconds, from anywhere.
    """

    def __init__(self, start: float = 0.0, source: Callable[[], float] = time.perf_counter) -> None:
        self._source = source
        self._lock = threading.Lock()
        self._origin = source() - start
        self._paused_at: float | None = None

    def now(self) -> float:
        """Seconds since the start, less the time spent paused [s]."""
        with self._lock:
            return self._now()

    def at(self, host: float) -> float:
        """What this clock said, or would have said, when its source said ``host`` [s].

        Readings of devices are dated with the source and told on this clock when they are taken
        over, so that a pause between the two cannot make them look new.
        """
        with self._lock:
            return self._now() - (self._source() - host)

    @property
    def source(self) -> Callable[[], float]:
        """What counts the seconds."""
        return self._source

    def pause(self) -> None:
        """Stand still until :meth:`resume`."""
        with self._lock:
            if self._paused_at is None:
                self._paused_at = self._now()

    def resume(self) -> None:
        """Go on from where it was paused."""
        with self._lock:
            if self._paused_at is not None:
                self._origin = self._source() - self._paused_at
                self._paused_at = None

    def restart(self) -> None:
        """Go back to zero; nothing may be reading the clock meanwhile."""
        with self._lock:
            self._origin = self._source()
            if self._paused_at is not None:
                self._paused_at = 0.0

    def follow(self, now: float, host: float) -> None:
        """Say ``now`` [s] when the source says ``host``: the time of another process's clock."""
        with self._lock:
            self._origin, self._paused_at = host - now, None

    def _now(self) -> float:
        return self._source() - self._origin if self._paused_at is None else self._paused_at
