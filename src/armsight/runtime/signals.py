"""Ctrl-C, SIGTERM and a terminal that goes away as an orderly end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals that end a run in order."""


def heeded() -> list[signal.Signals]:
    """Those of :data:`ENDS` that this process has not been told to ignore."""
    return [n for n in ENDS if n == signal.SIGINT or signal.getsignal(n) is not signal.SIG_IGN]


@contextmanager
def orderly_signals(stop: Callable[[str], None]) -> Iterator[None]:
    """Call ``stop`` with the signal's name at the first of :data:`ENDS`; a second one insists.

    SIGHUP comes when the connection breaks over which somebody works; under ``nohup`` it does not.
    Signals can only be caught in the main thread; elsewhere this does nothing. The handlers that
    stood before come back afterwards.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    seen = False

    def handle(number: int, _frame: FrameType | None) -> None:
        nonlocal seen
        if seen:
            raise KeyboardInterrupt
        seen = True
        stop(signal.Signals(number).name)

    before = {n: signal.signal(n, handle) for n in heeded()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
