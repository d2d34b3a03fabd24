"""What the simulated and the wall loop have in common: stages, health, requests from outside."""

from __future__ import annotations

import contextlib
import gc
import math
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from armsight.errors import ArmsightError, LoopError
from armsight.runtime.component import Component
from armsight.runtime.health import HealthMeter

SWITCH_INTERVAL = 0.0005
"""Python's default of 5 ms is a whole budget (design guard 3.8) [s]."""


class Loop(Protocol):
    """Runs components on a clock until told to stop."""

    meters: dict[str, HealthMeter]

    def run(self, until: float | None) -> None:
        """Run until the clock says ``until`` [s], or without end for None, or until stopped.

        Raises:
            LoopError: a component failed; the loop has ended.
        """
        ...

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from any thread and from a signal handler."""
        ...

    def wake(self, name: str, at: float) -> None:
        """Let a component do a round at ``at`` [s] besides its period: there is news for it."""
        ...

    def call_at(self, at: float, action: Callable[[], None]) -> None:
        """Do something once at ``at`` [s]."""
        ...

    def post(self, action: Callable[[], None]) -> None:
        """Do something between two rounds, as soon as possible."""
        ...

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""
        ...


class Inbox:
    """Functions that other threads ask the loop to call between two rounds."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.bell = threading.Event()

    def put(self, action: Callable[[], None]) -> None:
        """Leave a function and ring."""
        self._queue.put(action)
        self.bell.set()

    def run_all(self) -> None:
        """Call what was left, in order."""
        self.bell.clear()
        while True:
            try:
                action = self._queue.get_nowait()
            except queue.Empty:
                return
            action()


@contextlib.contextmanager
def short_pauses() -> Iterator[None]:
    """For the time of a run no thread waits long for another one or for the garbage collector.

    What is there before the run is left out of collections until its end: to look through a cell
    and its models takes Python over 0.1 s, in which no command would be sent.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    ours = gc.get_freeze_count() == 0  # somebody outside may have frozen theirs already
    if ours:
        gc.freeze()
    try:
        yield
    finally:
        if ours:
            gc.unfreeze()
        sys.setswitchinterval(interval)


def make_meters(components: Sequence[Component]) -> dict[str, HealthMeter]:
    """One meter a component.

    Raises:
        ValueError: two components have the same name, or one has no period.
    """
    for c in components:
        if not 0.0 < c.period < math.inf:
            raise ValueError(f"{c.name}: its period is {c.period} s, expected above 0")
    meters = {c.name: HealthMeter(c.name, c.period) for c in components}
    if len(meters) != len(components):
        raise ValueError(f"component names must be unique: {[c.name for c in components]}")
    return meters


def do_round(component: Component, meter: HealthMeter, now: float) -> float:
    """One update, timed and counted; returns the seconds of computing [s].

    Raises:
        LoopError: the component raised; the cause is kept.
    """
    began = time.perf_counter()
    with failing_as(component.name, meter, now):
        component.update(now)
    seconds = time.perf_counter() - began
    meter.round(now, seconds)
    return seconds


@contextlib.contextmanager
def failing_as(name: str, meter: HealthMeter, now: float) -> Iterator[None]:
    """Whatever is raised inside is a component's failure at ``now`` [s].

    Raises:
        LoopError: something was raised; the cause is kept.
    """
    try:
        yield
    except ArmsightError as error:
        meter.problem(str(error))
        raise LoopError(f"{name}: {error}") from error
    except Exception as error:
        meter.problem(f"{type(error).__name__}: {error}")
        raise LoopError(
            f"{name} failed at {now:.3f} s ({type(error).__name__}: {error}); "
            "the arm was stopped; run again with --debug for the trace"
        ) from error
