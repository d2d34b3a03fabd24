"""A device behind a thread of its own, so that nobody else ever waits for it.

The thread opens the driver, reads it, and between two readings calls what it is asked to. Whoever
takes the newest reading also looks whether the thread has come back in time from the driver's code;
if it has not, the device is lost, the thread is left to itself (Python cannot end it; it is a
daemon, so the process can end), and where that is wanted another one opens the device anew.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, Protocol, TypeVar

from armsight.devices.clock_map import ClockMap
from armsight.devices.newest import Newest
from armsight.errors import ArmsightError, DeviceError, DeviceLostError

log = logging.getLogger(__name__)

OPEN_SECONDS = 15.0
"""A driver has to open its device in this time [s]: cameras load firmware."""
STOP_SECONDS = 0.25
"""A stop or a close has to return in this time [s]."""
NOTICED = 0.05
"""Between two looks at a device at most so much is counted against it [s]: a process that stood
still as a whole, to compile or to swap, says nothing of its devices."""
BACKOFF = (0.5, 8.0)
"""A lost device is opened again after this [s], then twice that, up to the second figure."""
ABANDONED = 6
"""So many threads may hang in one device's driver before it is given up."""
WELL = 5.0
"""A device that was read for so long begins again with the shortest pause [s]."""

_left_behind: list[str] = []


def left_behind() -> tuple[str, ...]:
    """Calls of drivers that have hung since the process began, in words."""
    return tuple(_left_behind)


Stage = Literal["opening", "open", "lost", "closed"]
Reading = TypeVar("Reading")
Driver = TypeVar("Driver", bound="Closes")


class Closes(Protocol):
    """All that a line itself needs of a driver."""

    def close(self) -> None:
        """Let go of the device."""
        ...


@dataclass(frozen=True)
class DeviceHealth:
    """How a device is doing.

    Attributes:
        name: of the device, with its kind.
        stage: ``opening``, ``open``, ``lost`` (and opened again, where that is wanted), ``closed``.
        reason: why it is lost, or empty.
        readings: so far; opened: times that it was opened.
        clock_error: how wrong its stamps may be [s], see :class:`ClockMap`.
        clock_drift: of its clock against the computer's, as a share.
    """

    name: str
    stage: Stage
    reason: str = ""
    readings: int = 0
    opened: int = 0
    clock_error: float = 0.0
    clock_drift: float = 0.0

    def with_clock(self, times: ClockMap) -> DeviceHealth:
        """The same with what is known of the device's clock."""
        return replace(self, clock_error=times.error, clock_drift=times.drift)


@dataclass
class Asked:
    """Something that the device's thread shall do; ``error`` says why not, once it is ``done``."""

    what: str
    job: Callable[[Any], Any]
    done: threading.Event
    result: Any = None
    error: DeviceError | None = None


class Line(Generic[Driver, Reading]):
    """One device and its thread.

    Args:
        name: for messages, such as ``camera 'front'``.
        opener: makes the driver; called in the device's thread.
        read: one reading from the driver, checked and dated, or None; what it raises loses the
            device.
        deadline: a read that has not returned in this time has hung [s].
        silence: without a new reading for so long the device is lost [s].
        pause: least time between the beginnings of two reads [s].
        reopen: whether a lost device is opened again.
        now: counts seconds.
    """

    def __init__(
        self,
        name: str,
        opener: Callable[[], Driver],
        read: Callable[[Driver], Reading | None],
        *,
        deadline: float = 1.0,
        silence: float = 2.0,
        pause: float = 0.001,
        reopen: bool = True,
        now: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.name = name
        self.newest: Newest[Reading] = Newest()
        self._opener = opener
        self._read = read
        self._deadline = deadline
        self._silence = silence
        self._pause = pause
        self._reopen = reopen
        self._now = now
        self._lock = threading.Condition()
        self._calls: deque[Asked] = deque()
        self._generation = 0
        self._hung: set[int] = set()
        self._beside: dict[str, threading.Thread] = {}
        self._driver: Driver | None = None
        self._stage: Stage = "opening"
        self._reason = ""
        self._doing: tuple[str, float] | None = None
        self._looked = now()
        self._busy = self._silent = 0.0
        self._readings = self._opened = 0
        self._first = threading.Event()
        self._start(0.0)

    # -- for anybody ----------------------------------------------------------------------------

    def wait_open(self, seconds: float = OPEN_SECONDS) -> Driver:
        """The driver, once it is open.

        Raises:
            DeviceError: it cannot be opened, or did not open in time; it is closed again.
        """
        opened = self._first.wait(seconds)
        with self._lock:
            if opened and self._driver is not None:
                return self._driver
            self._stage = "closed"
            self._generation += 1
            self._lock.notify_all()
            late = f"{self.name}: opening has not returned for {seconds:g} s"
            raise DeviceError(self._reason or late)

    def check(self) -> None:
        """Look after the device.

        Raises:
            DeviceError: it is lost, and why.
        """
        with self._lock:
            now = self._now()
            passed = min(now - self._looked, NOTICED)
            self._looked = now
            self._busy += passed
            self._silent += passed
            doing, stage, busy, silent = self._doing, self._stage, self._busy, self._silent
        if doing is not None and busy > doing[1]:
            what, limit = doing
            self._lose(f"{self.name}: {what} has not returned for {limit:g} s", hung=True)
        elif stage == "open" and silent > self._silence:
            self._lose(f"{self.name}: nothing new for {self._silence:g} s", hung=False)
        with self._lock:
            if self._reason:
                raise self._error(self._reason)
            if self._stage == "closed":
                raise DeviceError(f"{self.name} is closed")

    def call(self, what: str, job: Callable[[Driver], Any], seconds: float) -> Any:
        """Let the device's thread call something of the driver, and wait for its result.

        Raises:
            DeviceError: the device is lost, or the driver raised; or it took longer than
                ``seconds`` [s]: then the device is lost.
        """
        self.check()
        call = self.post(what, job)
        waited = 0.0
        while not call.done.wait(0.5 * NOTICED) and waited < seconds:
            waited += 0.5 * NOTICED
        if not call.done.is_set():
            with self._lock:
                doing = what if self._doing is None else self._doing[0]
            self._lose(f"{self.name}: {doing} has not returned for {seconds:g} s", hung=True)
            raise self._error(self._reason)
        if call.error is not None:
            raise call.error
        return call.result

    def post(self, what: str, job: Callable[[Driver], Any]) -> Asked:
        """Let the device's thread call something of the driver, without waiting for it."""
        call = Asked(what, job, threading.Event())
        with self._lock:
            self._calls.append(call)
            self._lock.notify_all()
        return call

    def beside(self, what: str, job: Callable[[Driver], Any]) -> None:
        """Call something of the driver in a thread for it alone, whatever the device's own does.

        Raises:
            DeviceError: it raised, or did not return within :data:`STOP_SECONDS`.
        """
        with self._lock:
            driver, before = self._driver, self._beside.get(what)
        if driver is None:
            return
        hangs = f"{self.name}: {what} has not returned for {STOP_SECONDS:g} s; it is left to itself"
        if before is not None and before.is_alive():
            raise DeviceError(hangs)
        errors: list[BaseException] = []

        def run() -> None:
            try:
                job(driver)
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=run, name=f"armsight-{self.name}-{what}", daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system has no more threads: a stop cannot wait for one
            run()
        else:
            thread.join(STOP_SECONDS)
        if thread.is_alive():
            self._beside[what] = thread
            _left_behind.append(hangs)
            raise DeviceError(hangs)
        if errors:
            raise DeviceError(_told(self.name, what, errors[0])) from errors[0]

    def set_silence(self, seconds: float) -> None:
        """Count the device lost when it had nothing new for so long [s]."""
        with self._lock:
            self._silence = seconds

    def health(self) -> DeviceHealth:
        """How it is."""
        with self._lock:
            return DeviceHealth(self.name, self._stage, self._reason, self._readings, self._opened)

    def close(self) -> None:
        """Let go of the device; may be repeated.

        Raises:
            DeviceError: the driver's close() raised or did not return in time.
        """
        with self._lock:
            if self._stage == "closed":
                return
            self._stage = "closed"
            self._generation += 1
            self._fail_calls(DeviceError(f"{self.name} is closed"))
            self._lock.notify_all()
        self.beside("close()", lambda driver: driver.close())

    # -- the device's thread --------------------------------------------------------------------

    def _start(self, after: float) -> None:
        with self._lock:
            self._generation += 1
            args = (self._generation, after)
        threading.Thread(
            target=self._work, args=args, name=f"armsight-{self.name}", daemon=True
        ).start()

    def _work(self, mine: int, after: float) -> None:
        pause = max(after, BACKOFF[0])
        if after and not self._sleep(mine, after):
            return
        while self._mine(mine):
            began = self._now()
            try:
                self._serve(mine)
            except BaseException as error:
                told = str(error) if isinstance(error, ArmsightError) else ""
                self._settle(mine, told or _told(self.name, "read()", error))
            if self._now() - began > WELL:
                pause = BACKOFF[0]
            if not self._reopen or not self._sleep(mine, pause):
                return
            pause = min(2.0 * pause, BACKOFF[1])

    def _serve(self, mine: int) -> None:
        """Open, then read until something goes wrong or the line is taken away."""
        driver = self._open(mine)
        if driver is None:
            return
        while self._mine(mine):
            self._answer(mine, driver)
            began = self._now()
            self._enter(mine, "read()", self._deadline)
            reading = self._read(driver)
            if not self._leave(mine):
                return
            with self._lock:
                if mine != self._generation:
                    return
                if reading is not None:
                    self._silent = 0.0
                    self._readings += 1
                    self._reason = ""
                    self.newest.put(reading)
                rest = began + self._pause - self._now()
                if rest > 0.0 and not self._calls:
                    self._lock.wait(rest)

    def _open(self, mine: int) -> Driver | None:
        with self._lock:
            if mine != self._generation:
                return None
            if self._stage != "lost":
                self._stage = "opening"
        self._enter(mine, "opening", OPEN_SECONDS)
        try:
            driver = self._opener()
        except BaseException as error:
            self._leave(mine)
            told = str(error) if isinstance(error, ArmsightError) else ""
            self._settle(mine, told or _told(self.name, "opening", error))
            self._first.set()
            return None
        if not self._leave(mine):
            _quietly_close(self.name, driver)
            return None
        with self._lock:
            if mine != self._generation:
                return None
            self._driver = driver
            self._stage = "open"
            self._silent = 0.0
            self._opened += 1
        self._first.set()
        return driver

    def _answer(self, mine: int, driver: Driver) -> None:
        while True:
            with self._lock:
                if mine != self._generation or not self._calls:
                    return
                call = self._calls.popleft()
            self._enter(mine, call.what, self._deadline)
            try:
                call.result = call.job(driver)
            except BaseException as error:
                told = str(error) if isinstance(error, ArmsightError) else ""
                call.error = DeviceError(told or _told(self.name, call.what, error))
                call.error.__cause__ = error
            self._leave(mine)
            call.done.set()

    def _enter(self, mine: int, what: str, limit: float) -> None:
        with self._lock:
            if mine == self._generation:
                self._doing = (what, limit)
                self._busy = 0.0

    def _leave(self, mine: int) -> bool:
        with self._lock:
            if mine != self._generation:
                self._hung.discard(mine)  # it came back after all
                return False
            self._doing = None
            return True

    def _mine(self, mine: int) -> bool:
        with self._lock:
            return mine == self._generation

    def _sleep(self, mine: int, seconds: float) -> bool:
        """Whether the line is still this thread's afterwards."""
        end = self._now() + seconds
        with self._lock:
            while mine == self._generation and self._now() < end:
                self._lock.wait(end - self._now())
            return mine == self._generation

    # -- losing it ------------------------------------------------------------------------------

    def _settle(self, mine: int, reason: str) -> None:
        """The device's own thread found that it is lost: close it, and say so."""
        with self._lock:
            if mine != self._generation:
                return
            self._doing = None
            self._stage, self._reason = "lost", reason
            driver = self._driver
            if self._reopen:
                self._driver = None
            self._fail_calls(self._error(reason))
        log.warning("%s", reason)
        if self._reopen and driver is not None:
            self._enter(mine, "close()", self._deadline)
            _quietly_close(self.name, driver)
            self._leave(mine)

    def _lose(self, reason: str, *, hung: bool) -> None:
        """Somebody else found that it is lost: its thread is left to itself."""
        with self._lock:
            if self._stage == "closed" or (self._stage == "lost" and not hung):
                return
            self._stage, self._reason, self._doing = "lost", reason, None
            if hung:
                _left_behind.append(reason)
                self._hung.add(self._generation)
            self._generation += 1
            driver = self._driver
            if self._reopen:
                self._driver = None
            self._fail_calls(self._error(reason))
            self._lock.notify_all()
            hopeless = len(self._hung) >= ABANDONED
            if hopeless:
                self._reason = f"{reason}; {ABANDONED} calls hang in its driver: it is given up"
        log.warning("%s", reason)
        if not self._reopen:
            return
        if driver is not None:  # closing may free what hangs; it may hang as well
            threading.Thread(target=_quietly_close, args=(self.name, driver), daemon=True).start()
        if not hopeless:
            self._start(BACKOFF[0])

    def _error(self, reason: str) -> DeviceError:
        return DeviceError(reason) if self._reopen else DeviceLostError(reason)

    def _fail_calls(self, error: DeviceError) -> None:
        while self._calls:
            call = self._calls.popleft()
            call.error = error
            call.done.set()


def _quietly_close(name: str, driver: Closes) -> None:
    try:
        driver.close()
    except BaseException as error:
        log.warning("%s", _told(name, "close()", error))


def _told(name: str, what: str, error: BaseException) -> str:
    words = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(": ")
    return f"{name}: {what} failed ({words})"
