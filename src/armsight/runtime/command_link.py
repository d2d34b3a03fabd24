"""The session's end of the process in which its command path runs."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from armsight.devices.clock import WallClock
from armsight.devices.driven_arm import ArmRecipe
from armsight.devices.line import OPEN_SECONDS, STOP_SECONDS
from armsight.errors import DeviceError, DeviceLostError
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
    Times,
)
from armsight.runtime.wire import Wire

log = logging.getLogger(__name__)

BOOT = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from armsight.runtime.command_process import main; main()"
)
ENVIRONMENT = {
    # One thread of linear algebra: small matrices gain nothing by more, and more busy-wait.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    # glibc keeps freed maps for the next ones: to get fresh pages took 4 of 5 ms a map.
    "MALLOC_MMAP_THRESHOLD_": str(1 << 28),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 29),
    "MALLOC_TOP_PAD_": str(1 << 26),
}
START_SECONDS = 60.0
"""A process has to be there and to have opened its arm in this time, on a busy machine [s]."""
READY_SECONDS = 600.0
"""A guard has to be made and warmed up in this time [s]: its kernels may have to be compiled."""
END_SECONDS = 3.0
"""A run has to have ended in this time after it was told to [s]."""
CLOSE_SECONDS = 3 * STOP_SECONDS
"""It has to have let go of its arm in this time after it was told to [s]."""

RESCUES = (0.0, 0.05, 0.2)
"""Pauses before each attempt to stop the arm of a process that is gone [s]: it may first have to
notice that its connection is."""


def movable(arm: ArmRecipe) -> bool:
    """Whether another process could open this arm: its driver's class has to be importable."""
    if getattr(arm.opener, "__module__", "__main__") == "__main__":
        return False
    try:
        pickle.dumps(arm)
    except Exception:  # a class within a function, a lambda, settings of a stranger's type
        return False
    return True


class CommandLink:
    """Starts the process, tells it what to do, and knows how it is.

    Args:
        arm: that it opens.
        clock: of the cell.

    Attributes:
        on_state: called with every word of it, in a thread of the link.

    Raises:
        DeviceError: the arm cannot be opened.
    """

    def __init__(self, arm: ArmRecipe, clock: WallClock) -> None:
        self.arm = arm
        self.on_state: Callable[[State], None] = lambda state: None
        self._clock = clock
        self._news = threading.Condition()
        self._state = State(None, None)
        self._answers: dict[type, Any] = {}
        self._halts = 0
        self._lost = ""
        self._closed = False
        self._rescue = threading.Thread(target=self._stop_anew, name="armsight-stop", daemon=True)
        self._unsaved = ""
        place = json.dumps([*(str(p) for p in sys.path), str(Path.cwd())])
        self._process = subprocess.Popen(  # noqa: S603 - our own words, no shell
            [sys.executable, "-c", BOOT, place],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ENVIRONMENT,
            **_apart(),
        )
        incoming, outgoing = self._process.stdout, self._process.stdin
        assert incoming is not None
        assert outgoing is not None
        self._wire = Wire(incoming, outgoing)
        self._wire.on_unsent = self._unsent
        self._reader = threading.Thread(target=self._listen, name="armsight-link", daemon=True)
        self._reader.start()
        try:
            opened = self._ask(Open(arm, self._times()), Opened, START_SECONDS + OPEN_SECONDS)
            if opened.problem:
                raise DeviceError(opened.problem)
        except BaseException:
            with contextlib.suppress(DeviceError):
                self.close()
            raise

    @property
    def state(self) -> State:
        """Its newest word.

        Raises:
            DeviceLostError: the process is gone.
        """
        with self._news:
            if self._lost:
                raise DeviceLostError(self._lost)
            return self._state

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def ended(self) -> str | None:
        """Why the guard commands no more; None while it does."""
        with self._news:
            answer = self._answers.get(Ended)
        return None if answer is None else str(answer.problem)

    @property
    def slow(self) -> bool:
        """Whether earlier news have not been taken yet."""
        return self._wire.waiting(News)

    def begin(self, order: Begin) -> None:
        """Have a guard made; :meth:`wait_ready` waits for it."""
        self._forget(Ready)
        self._wire.send(order)

    def wait_ready(self) -> None:
        """Wait for the guard that was begun.

        Raises:
            DeviceError: it could not be made, or the process is gone.
        """
        ready = self._wait(Ready, READY_SECONDS)
        if ready.problem:
            raise DeviceError(f"the guard cannot be made in its own process: {ready.problem}")

    def run(self) -> None:
        """Let the guard command the arm."""
        self._forget(Ended)
        self._wire.send(Run(self._times()))

    def tell(self, news: News) -> None:
        """Something that the guard looks at."""
        self._wire.send(news)

    def end(self) -> None:
        """Let the guard command no more, and wait until it does not; a process that hangs ends."""
        self._wire.send(End())
        try:
            self._wait(Ended, END_SECONDS)
        except DeviceError as error:
            self.give_up(str(error))

    def halt(self) -> None:
        """Tell the arm to stop.

        Raises:
            DeviceError: it could not be told.
        """
        with self._news:
            if self._closed:
                return  # it was stopped when it was let go of
            self._halts += 1
            number, lost = self._halts, self._lost
        if lost:
            self._ask_rescue(lost)
            return
        self._wire.send(Halt(number))
        end = time.monotonic() + 2 * STOP_SECONDS
        with self._news:
            while (answer := self._answers.get(Halted)) is None or answer.number < number:
                if self._lost or not self._news.wait(max(end - time.monotonic(), 0.0)):
                    break
            lost = self._lost
        if answer is not None and answer.number >= number:
            if answer.problem:
                raise DeviceError(answer.problem)
        elif lost:
            self._ask_rescue(lost)
        else:
            self.give_up(f"{self._name}: it has not said that the arm stops")
            self._ask_rescue(self._lost)

    def give_up(self, reason: str) -> None:
        """The process hangs: end it, and stop the arm through a connection of our own."""
        self._process.kill()
        self._lose(reason)

    def close(self) -> None:
        """End the process, the arm stopped before; may be repeated.

        Raises:
            DeviceError: the arm could not be let go of in order.
        """
        with self._news:
            if self._closed:
                return
            lost = self._lost
            self._closed = True
        try:
            closed = None if lost else self._ask(Close(), Closed, CLOSE_SECONDS)
        finally:
            self._wire.close()
            try:
                self._process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._reader.join(STOP_SECONDS)
        if closed is not None and closed.problem:
            raise DeviceError(closed.problem)

    # -- inside -----------------------------------------------------------------------------------

    @property
    def _name(self) -> str:
        return f"arm {self.arm.settings.name}: the process of its command path"

    def _times(self) -> Times:
        return Times(self._clock.now(), time.perf_counter())

    def _forget(self, kind: type) -> None:
        with self._news:
            self._answers.pop(kind, None)

    def _ask(self, order: Any, kind: type, seconds: float) -> Any:
        self._forget(kind)
        self._wire.send(order)
        return self._wait(kind, seconds)

    def _wait(self, kind: type, seconds: float) -> Any:
        """The answer of a type.

        Raises:
            DeviceError: it did not come in time, or the process is gone.
        """
        end = time.monotonic() + seconds
        with self._news:
            while kind not in self._answers:
                if self._lost:
                    raise DeviceLostError(self._lost)
                if not self._news.wait(max(end - time.monotonic(), 0.0)):
                    raise DeviceError(f"{self._name} has not answered for {seconds:g} s")
            return self._answers[kind]

    def _listen(self) -> None:
        try:
            while True:
                word = self._wire.receive()
                if isinstance(word, State):
                    with self._news:
                        self._state = _merged(self._state, word)
                    self.on_state(word)
                else:
                    with self._news:
                        self._answers[type(word)] = word
                        self._news.notify_all()
        except (EOFError, OSError):
            pass
        if not self._closed:
            self._lose(f"{self._name} has ended ({_how(self._process)})")
        with self._news:
            self._lost = self._lost or f"{self._name} has ended"
            self._news.notify_all()

    def _unsent(self, message: Any, why: str) -> None:
        """An order that somebody's own parts are in: who waits for its answer is told at once."""
        if isinstance(message, Begin):
            words = f"what makes it cannot be handed over ({why}); leave Parts.elsewhere out"
            with self._news:
                self._answers[Ready] = Ready(words)
                self._news.notify_all()

    def _lose(self, reason: str) -> None:
        """Nobody commands the arm any more: stop it through a connection of our own."""
        with self._news:
            if self._lost or self._closed:
                return
            self._lost = reason
            self._rescue.start()
            self._news.notify_all()
        log.error("%s; the arm is told to stop through another connection", reason)

    def _stop_anew(self) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(STOP_SECONDS)  # an arm may take one connection at a time
        for pause in RESCUES:
            time.sleep(pause)
            try:
                driver = self.arm.opener(self.arm.settings)
                try:
                    driver.stop()
                finally:
                    with contextlib.suppress(BaseException):
                        driver.close()
            except BaseException as error:
                self._unsaved = f"{type(error).__name__}: {error}"
            else:
                self._unsaved = ""
                return

    def _ask_rescue(self, lost: str) -> None:
        """Whether the arm was told to stop after the process had gone.

        Raises:
            DeviceError: it could not be told.
        """
        self._rescue.join(4 * STOP_SECONDS)
        if self._rescue.is_alive():
            raise DeviceError(f"{lost}; another connection that would stop the arm hangs")
        if self._unsaved:
            raise DeviceError(
                f"{lost}; it cannot be stopped through another connection "
                f"({self._unsaved}): its own watchdog has to"
            )


def _merged(old: State, new: State) -> State:
    """The newest of everything."""
    kept = {
        field.name: getattr(old, field.name)
        for field in fields(State)
        if getattr(new, field.name) is None
    }
    return replace(new, **kept)


def _apart() -> dict[str, Any]:
    """Ctrl-C in a terminal is for the session, which ends both in order."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"process_group": 0}


def _how(process: subprocess.Popen[bytes]) -> str:
    """How a process ended."""
    try:
        code = process.wait(1.0)
    except subprocess.TimeoutExpired:
        return "its pipe is closed"
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
