"""The command path in a process of its own: arm, guard, nothing else.

Planning, mapping, tasks, the page and whatever their libraries do with Python's lock cannot hold it
up. It is started by :class:`~armsight.runtime.command_link.CommandLink` and lives no longer than
that: when the pipe ends, for whatever reason, the arm is told to stop before anything else.
"""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import os
import queue
import signal
import sys
import time
from dataclasses import dataclass
from threading import Thread
from typing import Any

from armsight.devices.clock import WallClock
from armsight.devices.data import JointState
from armsight.devices.driven_arm import DrivenArm
from armsight.errors import ArmsightError, DeviceError, DeviceLostError, LoopError
from armsight.motion.data import GuardStatus, PlanRequest
from armsight.runtime.channels import Channels, pursued
from armsight.runtime.command_messages import (
    Begin,
    Close,
    Closed,
    End,
    Ended,
    Halt,
    Halted,
    News,
    Open,
    Opened,
    Ready,
    Run,
    State,
)
from armsight.runtime.components import GuardComponent
from armsight.runtime.latency import Latency
from armsight.runtime.priority import lower_priority, raise_priority
from armsight.runtime.sensing import SensingComponent
from armsight.runtime.signals import heeded
from armsight.runtime.snapshot_memory import SnapshotReader
from armsight.runtime.wall_loop import WallLoop, watch_heart
from armsight.runtime.wire import Wire

log = logging.getLogger(__name__)

POSTING = 0.004
"""Between two words to the session [s]."""
IDLE = 0.02
"""The same while nothing runs [s]."""
HEALTH = 0.25
"""Between two words on the health of guard and arm [s]."""


@dataclass
class _Running:
    """A guard with its loop."""

    channels: Channels
    guard: GuardComponent
    loop: WallLoop


class CommandPath:
    """Does what the session says. Also the component that reports to it.

    Args:
        wire: to the session.
    """

    name = "posting"
    period = POSTING

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._orders: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._clock = WallClock()
        self._reader = SnapshotReader()
        self._arm: DrivenArm | None = None
        self._running: _Running | None = None
        self._ending = self._leaving = False
        self._priority = ""
        self._told: tuple[GuardStatus | None, PlanRequest | None] = (None, None)
        self._health_due = 0.0

    def serve(self) -> None:
        """Obey until told to close, or until the session is gone."""
        Thread(target=self._listen, name="armsight-orders", daemon=True).start()
        try:
            while (order := self._next()) is not None:
                self._obey(order)
        finally:
            self._reader.close()
            arm = self._arm
            self._wire.send(Closed("" if arm is None else _problem(arm.close)))
            self._wire.close()

    def leave(self) -> None:
        """Stop the arm and end; from any thread, also a signal handler."""
        self._leaving = True
        self._orders.put(None)

    # -- orders -----------------------------------------------------------------------------------

    def _listen(self) -> None:
        """What cannot wait for the loop."""
        try:
            while True:
                order = self._wire.receive()
                if isinstance(order, News):
                    self._take(order)
                elif isinstance(order, Halt):
                    self._wire.send(Halted(order.number, self._halt()))
                elif isinstance(order, End):
                    self._ending = True
                elif isinstance(order, Close):
                    break
                else:
                    if isinstance(order, Run):
                        self._ending = False
                    self._orders.put(order)
        except EOFError:
            self._halt()  # the session is gone
        except Exception:
            log.exception("the command path cannot understand its session; it stops the arm")
            self._halt()
        self.leave()

    def _next(self) -> Any:
        while True:
            try:
                return self._orders.get(timeout=IDLE)
            except queue.Empty:
                if self._arm is not None:
                    self._post(self._clock.now())

    def _obey(self, order: Any) -> None:
        if isinstance(order, Open):
            self._clock.follow(order.times.now, order.times.host)
            self._wire.send(Opened(_problem(lambda: self._open(order))))
        elif isinstance(order, Begin):
            self._wire.send(Ready(_problem(lambda: self._begin(order))))
        elif isinstance(order, Run):
            self._clock.follow(order.times.now, order.times.host)
            self._wire.send(Ended(_problem(self._run)))

    def _open(self, order: Open) -> None:
        self._arm = order.arm.open(self._clock)

    def _begin(self, order: Begin) -> None:
        assert self._arm is not None
        channels = Channels()
        sensing = SensingComponent(channels, self._arm, (), (), order.sensing_period)
        guard = GuardComponent(
            channels,
            order.make(),
            self._arm,
            lambda now: pursued(channels.word.read(now), now, order.task, order.silent_after),
            Latency(0.0, "real"),
            order.guard_period,
        )
        loop = WallLoop(self._clock, (sensing, guard, self), self._supervise, guard.halt)
        self._running = _Running(channels, guard, loop)
        self._told = (None, None)

    def _run(self) -> None:
        assert self._running is not None
        self._priority = raise_priority()
        self._running.guard.ended = self._leaving
        with contextlib.ExitStack() as stack:
            stack.callback(lower_priority)
            stack.push(lambda kind, error, trace: _stop_after(self._arm, error))
            self._running.loop.run(None)

    def _supervise(self) -> None:
        running, arm = self._running, self._arm
        assert running is not None
        assert arm is not None
        if self._ending or self._leaving:
            running.loop.stop()
        watch_heart(running.loop, self._clock.now(), arm.stop)

    def _halt(self) -> str:
        """Have nothing commanded any more in this run, and the arm stop; why it cannot be told."""
        if self._running is not None:
            return _problem(self._running.guard.halt)
        return "" if self._arm is None else _problem(self._arm.stop)

    def _take(self, news: News) -> None:
        running = self._running
        if running is None:
            return
        now, channels = self._clock.now(), running.channels
        running.guard.held = news.held
        for wrench in news.wrenches:
            channels.readings.put(wrench)
        if news.word is not None:
            channels.word.publish(news.word, now)
        if news.plan is not None:
            channels.plan.publish(news.plan, now)
        snapshot = None if news.ticket is None else self._reader.read(news.ticket)
        if snapshot is not None:
            channels.snapshot.publish(snapshot, self._clock.now())
        if snapshot is not None or news.plan is not None:
            running.loop.wake("guard", now)

    # -- reports ----------------------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Tell the session how it is."""
        self._post(now)

    def _post(self, now: float) -> None:
        if self._wire.waiting(State):
            return  # the session is slow; it gets the newest once it listens again
        arm, running = self._arm, self._running
        assert arm is not None
        joints, problem, lost = _joints(arm)
        status, request, health, device, words = None, None, None, None, ""
        if running is not None:
            status = running.channels.status.read(now)
            request = running.channels.request.read(now)
            before, self._told = self._told, (status, request)
            status = status if status is not before[0] else None
            request = request if request is not before[1] else None
            words = running.guard.problem
        if time.monotonic() >= self._health_due:
            self._health_due = time.monotonic() + HEALTH
            device = arm.health()
            health = None if running is None else running.loop.meters["guard"].report()
        self._wire.send(
            State(
                joints, arm.status, problem, lost, status, request, words, health, device,
                self._priority,
            )
        )  # fmt: skip


def _joints(arm: DrivenArm) -> tuple[JointState | None, str, bool]:
    """Newest joints; why there are none, and whether there never will be."""
    try:
        return arm.read(), "", False
    except DeviceError as error:
        return None, str(error), isinstance(error, DeviceLostError)


def _stop_after(arm: DrivenArm | None, error: BaseException | None) -> None:
    """Stop the arm; one that cannot be told is a problem beside that which ended the run."""
    problem = "" if arm is None else _problem(arm.stop)
    if problem and problem not in str(error):
        raise LoopError(problem if error is None else f"{error}; moreover {problem}") from error


def _problem(job: Any) -> str:
    """Do something; what went wrong, in words."""
    try:
        job()
    except ArmsightError as error:
        return str(error)
    except Exception as error:
        log.exception("the command path failed")
        return f"{type(error).__name__}: {error}"
    return ""


def main() -> None:
    """Serve whoever started this process, over its standard streams.

    Drivers may print: what they print goes to the error stream, and what they read is empty.
    """
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    faulthandler.enable()
    path = CommandPath(Wire(incoming, outgoing))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the session ends in order, and says so
    for number in heeded():
        if number != signal.SIGINT:
            signal.signal(number, lambda number, frame: path.leave())
    path.serve()
