"""A queue of jobs for another thread, bounded by the memory that they hold and by their age."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

SMALL = 64 * 1024
"""A job that holds less is always taken while there is room: joints and words cost no time."""


class ByteQueue:
    """Jobs on their way to the writing thread.

    Args:
        most: that they may hold [bytes].
        late: where the oldest has waited for so long [s], a large one is not taken by whoever does
            not wait: what comes first is written first, and what is behind is lost in a crash.
        now: counts seconds.
    """

    def __init__(
        self, most: int, late: float = math.inf, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._most = most
        self._late = late
        self._now = now
        self._held = 0
        self._jobs: deque[tuple[float, int, Callable[[], None]]] = deque()
        self._change = threading.Condition()
        self.closed = False

    def put(self, size: int, job: Callable[[], None], *, wait: bool) -> bool:
        """Leave a job; false if there is no room or it would be late, and ``wait`` is false."""
        with self._change:
            if not wait and size > SMALL and self._age() > self._late and not self.closed:
                return False
            while not self.closed and self._held > 0 and self._held + size > self._most:
                if not wait:
                    return False
                self._change.wait()
            if self.closed:
                return True  # the end was announced; this is no frame lost to a slow disk
            self._held += size
            self._jobs.append((self._now(), size, job))
            self._change.notify_all()
            return True

    def get(self) -> Callable[[], None] | None:
        """The oldest job; None once the queue is closed and empty."""
        with self._change:
            while not self._jobs and not self.closed:
                self._change.wait()
            if not self._jobs:
                return None
            _, size, job = self._jobs.popleft()
            self._held -= size
            self._change.notify_all()
            return job

    def _age(self) -> float:
        return self._now() - self._jobs[0][0] if self._jobs else 0.0

    def close(self, *, drop: bool = False) -> None:
        """Take no more; ``drop`` forgets what waits."""
        with self._change:
            self.closed = True
            if drop:
                self._jobs.clear()
                self._held = 0
            self._change.notify_all()
