"""A queue of jobs for another thread, bounded by the memory that the jobs hold."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable


class ByteQueue:
    """Jobs on their way to the writing thread, bounded by the memory that they hold."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._held = 0
        self._jobs: deque[tuple[int, Callable[[], None]]] = deque()
        self._change = threading.Condition()
        self.closed = False

    def put(self, size: int, job: Callable[[], None], *, wait: bool) -> bool:
        """Leave a job; false if there is no room and ``wait`` is false, or the queue is closed."""
        with self._change:
            while not self.closed and self._held > 0 and self._held + size > self._most:
                if not wait:
                    return False
                self._change.wait()
            if self.closed:
                return True  # the end was announced; this is no frame lost to a slow disk
            self._held += size
            self._jobs.append((size, job))
            self._change.notify_all()
            return True

    def get(self) -> Callable[[], None] | None:
        """The oldest job; None once the queue is closed and empty."""
        with self._change:
            while not self._jobs and not self.closed:
                self._change.wait()
            if not self._jobs:
                return None
            size, job = self._jobs.popleft()
            self._held -= size
            self._change.notify_all()
            return job

    def close(self, *, drop: bool = False) -> None:
        """Take no more; ``drop`` forgets what waits."""
        with self._change:
            self.closed = True
            if drop:
                self._jobs.clear()
                self._held = 0
            self._change.notify_all()
