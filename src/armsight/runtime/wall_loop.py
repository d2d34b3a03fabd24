"""The loop under the wall clock: a thread a component, deadlines counted."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable, Collection, Sequence

from armsight.devices.clock import WallClock
from armsight.devices.protocols import Clock
from armsight.errors import DeviceError, LoopError
from armsight.runtime.component import Component
from armsight.runtime.loop import Inbox, Loop, do_round, make_meters, short_pauses
from armsight.runtime.priority import go_first

NAP = 0.004
"""Longest sleep of the supervising thread [s]."""
JOIN_SECONDS = 2.0
"""How long the end of a run waits for its threads [s]; one that hangs is left to itself."""


HEARTBEAT = 0.25
"""The arm is stopped when the guard has been silent for longer [s]."""


class WallLoop:
    """Runs each component in a thread of its own.

    Args:
        clock: the workcell's time; paused with the loop if it is a :class:`WallClock`.
        components: each gets a thread.
        supervise: called every few milliseconds in the thread that called :meth:`run`; a simulated
            world is advanced here, and the guard's heartbeat is watched.
        halt: stops the arm for good; called at once, in the thread of a component that failed, and
            when the run ends, before its threads are waited for.
        urgent: names of components whose threads go before other programs, where that is granted.
    """

    def __init__(
        self,
        clock: Clock,
        components: Sequence[Component],
        supervise: Callable[[], None] = lambda: None,
        halt: Callable[[], None] = lambda: None,
        urgent: Collection[str] = (),
    ) -> None:
        self.clock = clock
        self.meters = make_meters(components)
        self._components = tuple(components)
        self._supervise = supervise
        self._halt = halt
        self._urgent = urgent
        self._bells = {c.name: threading.Event() for c in components}
        self._stop = threading.Event()
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._inbox = Inbox()
        self._calls: list[tuple[float, int, Callable[[], None]]] = []
        self._calls_lock = threading.Lock()
        self._ticket = itertools.count()
        self._failure: LoopError | None = None

    def stop(self) -> None:
        """End the run soon."""
        self._stop.set()
        self._inbox.bell.set()

    def pause(self, paused: bool) -> None:
        """Pause the clock where it can be; threads keep looking and find no time passing."""
        if isinstance(self.clock, WallClock):
            if paused:
                self.clock.pause()
            else:
                self.clock.resume()

    def post(self, action: Callable[[], None]) -> None:
        """Do something in the supervising thread, soon."""
        self._inbox.put(action)

    def wake(self, name: str, at: float) -> None:
        """News for a component: it does a round at once."""
        if at <= self.clock.now():
            self._bells[name].set()
        else:
            self.call_at(at, self._bells[name].set)

    def call_at(self, at: float, action: Callable[[], None]) -> None:
        """Do something once at a time [s], within a few milliseconds."""
        if at <= self.clock.now():
            action()
            return
        with self._calls_lock:
            heapq.heappush(self._calls, (at, next(self._ticket), action))

    def run(self, until: float | None) -> None:
        """Run until the clock says ``until`` [s], or until stopped."""
        end = math.inf if until is None else until
        self._stop.clear()
        self._failure = None
        with short_pauses():
            try:
                self._start_threads()
                while not self._stop.is_set() and self.clock.now() < end:
                    self._inbox.run_all()
                    self._supervise()
                    self._run_calls()
                    self._inbox.bell.wait(NAP)
            finally:
                self._end_threads()
        if self._failure is not None:
            raise self._failure

    def _run_calls(self) -> None:
        while True:
            with self._calls_lock:
                if not self._calls or self._calls[0][0] > self.clock.now():
                    return
                action = heapq.heappop(self._calls)[2]
            action()

    def _start_threads(self) -> None:
        self._over = over = threading.Event()  # a thread that hung in an earlier run stays ended
        self._threads = [
            threading.Thread(
                target=self._work, args=(c, over), name=f"armsight-{c.name}", daemon=True
            )
            for c in self._components
        ]
        for thread in self._threads:
            thread.start()

    def _end_threads(self) -> None:
        self._over.set()
        for bell in self._bells.values():
            bell.set()
        self._try_to_halt()
        end = time.monotonic() + JOIN_SECONDS
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))
        self._threads = []

    def _try_to_halt(self) -> None:
        with contextlib.suppress(DeviceError):  # told again, and heard, when the run has ended
            self._halt()

    def _work(self, component: Component, over: threading.Event) -> None:
        meter = self.meters[component.name]
        bell = self._bells[component.name]
        due = self.clock.now()
        last = -math.inf
        if component.name in self._urgent:
            go_first()
        while not over.is_set():
            now = self.clock.now()
            rung = bell.is_set()
            if now < due and not rung:
                bell.wait(min(due - now, NAP * 5))
                continue
            bell.clear()
            if now <= last:  # a paused clock: no time, no round
                over.wait(NAP)
                continue
            last = now
            if now >= due:
                late = math.floor((now - due) / component.period)
                if late > 0:
                    meter.missed(late)
                due += (late + 1) * component.period
            try:
                do_round(component, meter, now)
            except BaseException as error:  # a SystemExit would end the thread in silence
                if self._failure is None:
                    self._failure = _failure(component, error)
                self.stop()
                self._try_to_halt()
                return


def _failure(component: Component, error: BaseException) -> LoopError:
    if isinstance(error, LoopError):
        return error
    return LoopError(f"{component.name} ended itself ({type(error).__name__}); the arm was stopped")


def watch_heart(loop: Loop, now: float, stop: Callable[[], None]) -> None:
    """Stop the arm of a loop whose guard has been silent for :data:`HEARTBEAT` at ``now`` [s]."""
    last = loop.meters["guard"].last
    if math.isfinite(last) and now - last > HEARTBEAT:
        try:
            stop()
        except DeviceError:  # it is told again, and heard, when the run has ended
            loop.stop()
