"""How one thread hands its newest value to another: nobody waits, nobody sees half of one."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Newest(Generic[T]):
    """Holds the value that was put last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._value: T | None = None
        self._taken = True

    def put(self, value: T) -> None:
        """Replace whatever was there."""
        with self._lock:
            self._value, self._taken = value, False

    def take(self) -> T | None:
        """The newest value if it was not taken before, else None."""
        with self._lock:
            if self._taken:
                return None
            self._taken = True
            return self._value

    def peek(self) -> T | None:
        """The newest value, taken or not; None before the first."""
        with self._lock:
            return self._value

    def clear(self) -> None:
        """Forget it."""
        with self._lock:
            self._value, self._taken = None, True
