"""What all sensors behind drivers have in common: a thread, a clock map, the newest value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from armsight.devices.clock import WallClock
from armsight.devices.clock_map import ClockMap
from armsight.devices.line import Closes, DeviceHealth, Line

POLL = 0.002
"""Between looks at a device that does not wait for its readings [s]."""


class Dated(Protocol):
    """A driver's reading."""

    @property
    def stamp(self) -> float | None:
        """On the device's clock [s], or None."""
        ...


Raw = TypeVar("Raw", bound=Dated)
RawRead = TypeVar("RawRead", bound=Dated, covariant=True)
Value = TypeVar("Value")


class Reads(Closes, Protocol[RawRead]):
    """What is needed of a sensor's driver."""

    def read(self) -> RawRead | None:
        """The newest reading, or None."""
        ...


class DrivenSensor(Generic[Raw, Value]):
    """A sensor that is read by a thread of its own, and opened again when it is lost.

    Args:
        name: for messages, such as ``camera 'front'``.
        opener: makes the driver.
        accept: checks what an opened driver reports and returns the latency of its readings [s];
            what it raises is why the device cannot be opened.
        before: called before each read, in the device's thread.
        make: turns a reading, its time and its arrival on the host's clock [s] into a value; what
            it raises loses the device.
        clock: the cell's.
        deadline: a read that has not returned in this time has hung [s].
        silence: without anything new for so long the device is lost [s].

    Raises:
        DeviceError: it cannot be opened.
    """

    def __init__(
        self,
        name: str,
        opener: Callable[[], Reads[Raw]],
        accept: Callable[[Reads[Raw]], float],
        make: Callable[[Raw, float, float], Value],
        clock: WallClock,
        *,
        before: Callable[[Reads[Raw]], None] = lambda driver: None,
        deadline: float = 1.0,
        silence: float = 1.0,
    ) -> None:
        self.name = name
        self.clock = clock
        self._opener, self._accept, self._before, self._make = opener, accept, before, make
        self._map = ClockMap(name)
        self._stamp: float | None = None
        self.line: Line[Reads[Raw], Value] = Line(
            name,
            self._open,
            self._take,
            deadline=deadline,
            silence=silence,
            pause=POLL,
            now=clock.source,
        )
        self.line.wait_open()

    def take(self) -> Value | None:
        """The newest value that was not taken yet, its times on the host's clock, or None.

        Raises:
            DeviceError: the device is lost.
        """
        self.line.check()
        return self.line.newest.take()

    def health(self) -> DeviceHealth:
        """How it is."""
        return self.line.health().with_clock(self._map)

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self.line.close()

    # -- in the device's thread -----------------------------------------------------------------

    def _open(self) -> Reads[Raw]:
        driver = self._opener()
        try:
            self._map = ClockMap(self.name, self._accept(driver))
        except BaseException:
            driver.close()
            raise
        self._stamp = None
        return driver

    def _take(self, driver: Reads[Raw]) -> Value | None:
        self._before(driver)
        reading = driver.read()
        arrival = self.clock.source()
        if reading is None or (reading.stamp is not None and reading.stamp == self._stamp):
            return None
        self._stamp = reading.stamp
        return self._make(reading, self._map.map(reading.stamp, arrival), arrival)
