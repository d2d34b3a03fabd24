"""The loop under a simulated clock: events in order, the same for the same seed.

Rounds run in one thread. A component whose compute time is declared may have its computing done
beside the loop (:meth:`SimulatedLoop.beside`): what it works on is fixed when it begins, and what
it found comes in at its declared time, so the results do not depend on how fast the threads are.
"""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TypeVar

from armsight.runtime.component import Component
from armsight.runtime.loop import Inbox, do_round, failing_as, make_meters, short_pauses

Result = TypeVar("Result")

FALLEN_BEHIND = 0.25
"""Seconds behind the wanted speed after which catching up is given up."""
NAP = 0.02
"""Longest sleep between looks at the inbox [s]."""
GRACE = 5.0
"""Longest wait at the end of a run for what is still computed beside the loop [s]."""


class _Stage:
    """A component with its place in the schedule."""

    def __init__(self, component: Component, order: int) -> None:
        self.component = component
        self.order = order
        self.rounds_due = 0
        self.free_at = -math.inf


class SimulatedLoop:
    """Advances a simulated clock from event to event.

    A component that publishes ``charge`` (seconds its last round took on the simulated clock) is
    busy for that long: rounds that fall into it are late or counted as missed.

    Args:
        now: reads the clock; advance: moves it, with the world, to a time [s].
        components: in the order in which they run when due at the same time.
        speed: simulated seconds a second of wall time; inf runs as fast as it can.
    """

    def __init__(
        self,
        now: Callable[[], float],
        advance: Callable[[float], None],
        components: Sequence[Component],
        speed: float = math.inf,
    ) -> None:
        self._now = now
        self._advance = advance
        self.meters = make_meters(components)
        self._stages = {c.name: _Stage(c, i) for i, c in enumerate(components)}
        self._ticket = itertools.count()
        self._heap: list[tuple[float, int, int, Callable[[], None]]] = []
        self._stop = threading.Event()
        self._paused = threading.Event()
        self._inbox = Inbox()
        self._pool = ThreadPoolExecutor(len(components) or 1, "beside")
        self._computing: list[Future[object]] = []
        self._speed = speed
        self._anchor = (0.0, 0.0)
        self.wall_seconds = 0.0
        self.simulated_seconds = 0.0
        start = now()
        for stage in self._stages.values():
            self._schedule(stage, start, start)

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second from now on; inf for as fast as it can."""
        self._speed = speed
        self._rebase()

    @property
    def speed(self) -> float:
        """Wanted simulated seconds a second."""
        return self._speed

    def stop(self) -> None:
        """End the run soon."""
        self._stop.set()
        self._inbox.bell.set()

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""
        if paused:
            self._paused.set()
        else:
            self._paused.clear()
        self._inbox.bell.set()

    def post(self, action: Callable[[], None]) -> None:
        """Do something between two events."""
        self._inbox.put(action)

    def wake(self, name: str, at: float) -> None:
        """Give a component a round at a time [s] besides its period."""
        stage = self._stages[name]
        self._push(at, stage.order, lambda: self._extra_round(stage))

    def call_at(self, at: float, action: Callable[[], None]) -> None:
        """Do something once at a time [s]."""
        self._push(at, -1, action)

    def beside(
        self, name: str, at: float, job: Callable[[], Result], then: Callable[[Result], None]
    ) -> None:
        """Begin a component's computing now, beside the loop, and hand over its result at ``at``.

        Args:
            name: of the component; what the job raises is its failure.
            at: when the clock says this, the loop waits for the result [s].
            job: must not look at anything that the loop goes on changing.
            then: called by the loop with the result.
        """
        meter = self.meters[name]

        def timed() -> tuple[Result, float]:
            began = time.perf_counter()
            return job(), time.perf_counter() - began

        future = self._pool.submit(timed)
        self._computing = [f for f in self._computing if not f.done()]
        self._computing.append(future)  # type: ignore[arg-type]

        def finish() -> None:
            with failing_as(name, meter, at):
                result, seconds = future.result()
                meter.more(seconds)
                then(result)

        self.call_at(at, finish)

    def run(self, until: float | None) -> None:
        """Run until the clock says ``until`` [s], or until stopped; nothing is computed after."""
        end = math.inf if until is None else until
        self._stop.clear()
        self._rebase()
        began, clock_began = time.perf_counter(), self._now()
        try:
            with short_pauses():
                self._run(end)
        finally:
            # A map at work when the program ends finds its threads gone, and says that it failed.
            wait(self._computing, GRACE)
            self.wall_seconds += time.perf_counter() - began
            self.simulated_seconds += max(0.0, self._now() - clock_began)

    def _run(self, end: float) -> None:
        while not self._stop.is_set():
            self._inbox.run_all()
            if self._paused.is_set():
                self._inbox.bell.wait(NAP)
                self._rebase()
                continue
            at = self._heap[0][0] if self._heap else math.inf
            if at > end or math.isinf(at):
                self._advance(end)
                return
            if self._wait_for(at):
                continue
            at, _, _, action = heapq.heappop(self._heap)
            if at > self._now():
                self._advance(at)
            action()

    def _push(self, at: float, order: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (at, order, next(self._ticket), action))

    def _schedule(self, stage: _Stage, start: float, now: float) -> None:
        at = start + stage.rounds_due * stage.component.period
        self._push(max(at, now), stage.order, lambda: self._due_round(stage, start))

    def _due_round(self, stage: _Stage, start: float) -> None:
        now = self._now()
        if now < stage.free_at:
            self._push(stage.free_at, stage.order, lambda: self._due_round(stage, start))
            return
        period = stage.component.period
        late = math.floor((now - start) / period + 1e-9) - stage.rounds_due
        if late > 0:
            self.meters[stage.component.name].missed(late)
        stage.rounds_due += max(late, 0) + 1
        self._round(stage, now)
        self._schedule(stage, start, now)

    def _extra_round(self, stage: _Stage) -> None:
        now = self._now()
        if now < stage.free_at:
            self._push(stage.free_at, stage.order, lambda: self._extra_round(stage))
            return
        self._round(stage, now)

    def _round(self, stage: _Stage, now: float) -> None:
        do_round(stage.component, self.meters[stage.component.name], now)
        stage.free_at = now + float(getattr(stage.component, "charge", 0.0))

    def _rebase(self) -> None:
        self._anchor = (time.perf_counter(), self._now())

    def _wait_for(self, at: float) -> bool:
        """Sleep until it is time for an event; true if something else came up meanwhile."""
        if math.isinf(self._speed):
            return False
        wall, clock = self._anchor
        ahead = wall + (at - clock) / self._speed - time.perf_counter()
        if ahead < -FALLEN_BEHIND:
            self._rebase()
        if ahead <= 0:
            return False
        self._inbox.bell.wait(min(ahead, NAP))
        return ahead > NAP or self._inbox.bell.is_set()
