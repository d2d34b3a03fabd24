"""Calls of code that others wrote: what it raises is caught, and what never returns is given up."""

from __future__ import annotations

import queue
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from armsight.errors import ArmsightError

Result = TypeVar("Result")
FIRST = 5.0
"""A first call may take so many times longer: it compiles, or loads a network."""


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """What became of a call.

    Attributes:
        value: what it returned; None if it did not.
        fault: why not, in words; empty when it returned.
        seconds: that it took [s].
        hung: it has not returned, and nothing more is asked of that thread.
    """

    value: Result | None
    fault: str
    seconds: float
    hung: bool = False


class ForeignThread:
    """One thread for the calls of one task or perceiver, so that they come one after the other.

    The thread is a daemon: code that never returns cannot keep the process from ending. It ends
    with this object, so it must not know it.

    Args:
        name: of the thread.
        patience: how long a call may take on the wall clock [s]. Much longer than any deadline:
            who is merely late is answered by the guard long before.
        first: the first call may take so many times as long.
    """

    def __init__(self, name: str, patience: float, first: float = FIRST) -> None:
        self._name = name
        self._patience, self._later = first * patience, patience
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self.hung = False

    def begin(self, job: Callable[[], Result]) -> Callable[[], Outcome[Result]]:
        """Start a call; what is returned waits for its outcome."""
        if self.hung:
            return lambda: Outcome(None, "has hung", 0.0, True)
        if self._thread is None:
            jobs = self._jobs
            self._thread = threading.Thread(
                target=_work, args=(jobs,), name=self._name, daemon=True
            )
            self._thread.start()
            weakref.finalize(self, jobs.put, None)
        done = threading.Event()
        box: list[Outcome[Result]] = []

        def call() -> None:
            began = time.perf_counter()
            try:
                value = job()
                box.append(Outcome(value, "", time.perf_counter() - began))
            except ArmsightError as error:
                box.append(Outcome(None, str(error), time.perf_counter() - began))
            except BaseException as error:  # a foreign SystemExit must not end a thread in silence
                words = f"{type(error).__name__}: {error}"
                box.append(Outcome(None, words, time.perf_counter() - began))
            done.set()

        began = time.monotonic()
        patience = self._patience
        self._patience = self._later
        self._jobs.put(call)

        def wait() -> Outcome[Result]:
            left = patience - (time.monotonic() - began)
            if done.wait(max(left, 0.0)):
                return box[0]
            self.hung = True
            return Outcome(None, f"did not return within {patience:g} s", patience, True)

        return wait

    def call(self, job: Callable[[], Result]) -> Outcome[Result]:
        """Make a call and wait for its outcome."""
        return self.begin(job)()


def _work(jobs: queue.SimpleQueue[Callable[[], None] | None]) -> None:
    while (job := jobs.get()) is not None:
        job()
        del job  # it may know the owner, who could not go while the thread waits
