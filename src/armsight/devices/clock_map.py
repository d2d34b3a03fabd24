"""From a device's own time to the computer's: offset and drift, with a stated error.

A reading that the device dated d arrives at h = offset + (1 + drift) d + delay, with a delay that
is never below its least. The line under all points (d, h) that is nearest to them is offset and
drift plus the least delay (Moon, Skelly, Towsley 1999, "Estimation and removal of clock skew from
network delay measurements"); it is an edge of their lower convex hull, the one over their mean
(Zhang, Liu, Xia 2002, "Clock synchronization algorithms for network measurements"). Of every half
second only the reading that came fastest is kept.
"""

from __future__ import annotations

import math
from collections import deque

from armsight.errors import DeviceError

BIN = 0.5
"""One point is kept of so long [s]."""
BINS = 120
"""Points that are kept: a minute."""
DRIFT_AFTER = 10.0
"""A drift is estimated from readings over at least so long [s]."""
GREATEST_DRIFT = 1e-3
"""No device's clock runs faster or slower than this: a bad quartz does 1e-4."""
STEP = 0.25
"""A reading that is so far from where the map expects it [s]: the device's clock was set."""
LATE = 2.0
"""Readings that come late by :data:`STEP` for so long [s] are no hiccup."""
STEPS = 3
"""A device's clock may be set so often within the kept time."""
UNKNOWN_DRIFT = 1e-4
"""Counted into the error while the drift is not known."""


class ClockMap:
    """Maps one device's stamps to the host's clock.

    Args:
        name: of the device, for messages.
        latency: its least delay, measurement to arrival [s]; one-way times cannot tell it, so it is
            believed, and what it is wrong by is not in :attr:`error`.
    """

    def __init__(self, name: str, latency: float = 0.0) -> None:
        self._name = name
        self._latency = latency
        self._steps: deque[float] = deque()
        self._last = self._bin = -math.inf
        self._late_since = math.inf
        self._restart()

    @property
    def drift(self) -> float:
        """How much slower the device's clock runs than the host's, as a share; 0 while unknown."""
        return self._drift

    @property
    def error(self) -> float:
        """How wrong a mapped stamp may be, the declared latency taken as true [s]."""
        return self._error

    def map(self, stamp: float | None, arrival: float) -> float:
        """The host's time of a measurement [s].

        Args:
            stamp: on the device's clock, or None: then it is the arrival less the latency.
            arrival: when it came, on the host's clock.

        Raises:
            DeviceError: the device lies about time, in what way.
        """
        if stamp is None:
            return arrival - self._latency
        stamp = float(stamp)
        if not math.isfinite(stamp):
            raise DeviceError(f"{self._name} lies about time: it dates a reading {stamp}")
        if self._points:
            late = arrival - self._line(stamp)
            if stamp < self._last or -late > STEP + self._error:
                self._stepped(stamp, arrival)
            elif late > STEP + self._error:
                # It was held up on its way, so it is as old as it says: to date it by its arrival
                # would make an old picture a new one.
                self._held_up(late, arrival)
                self._last = stamp
                return self._line(stamp) - self._latency
        self._late_since = math.inf
        self._last = stamp
        if self._add(stamp, arrival):
            self._fit()
        # Never later than the arrival allows, whatever the line says.
        return min(self._line(stamp), arrival) - self._latency

    def _line(self, stamp: float) -> float:
        """Arrival of a reading that takes the least delay."""
        return self._origin[1] + (1.0 + self._drift) * (stamp - self._origin[0])

    def _restart(self) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=BINS)
        self._origin = (0.0, 0.0)
        self._drift = 0.0
        self._error = 0.0

    def _stepped(self, stamp: float, arrival: float) -> None:
        off = self._line(stamp) - arrival
        self._steps.append(arrival)
        while self._steps[0] < arrival - BIN * BINS:
            self._steps.popleft()
        if len(self._steps) > STEPS:
            raise DeviceError(
                f"{self._name} lies about time: its clock jumped {len(self._steps)} times within "
                f"{arrival - self._steps[0]:.1f} s, last by {off:+.3g} s; are its stamps seconds?"
            )
        self._restart()

    def _held_up(self, late: float, arrival: float) -> None:
        self._late_since = min(self._late_since, arrival)
        if arrival - self._late_since > LATE:
            raise DeviceError(
                f"{self._name}: its readings come {late:.2f} s later than they used to, for "
                f"{LATE:g} s now; does its driver read the newest one, or is its clock slow?"
            )

    def _add(self, stamp: float, arrival: float) -> bool:
        """Whether the points are others now."""
        points = self._points
        if not points or stamp - self._bin >= BIN:
            self._bin = stamp
            points.append((stamp, arrival))
        elif arrival - stamp < points[-1][1] - points[-1][0]:
            points[-1] = (stamp, arrival)
        else:
            return False
        return True

    def _fit(self) -> None:
        points = list(self._points)
        span = points[-1][0] - points[0][0]
        if span < DRIFT_AFTER:
            self._drift = 0.0
            self._origin = min(points, key=lambda p: p[1] - p[0])
        else:
            self._origin, self._drift = lower_line(points)
            if abs(self._drift) > GREATEST_DRIFT:
                raise DeviceError(
                    f"{self._name} lies about time: in {span:.0f} s its clock ran "
                    f"{-100 * self._drift:+.2f} % against the computer's, at most "
                    f"{100 * GREATEST_DRIFT:g} % is believable"
                )
        late = sorted(h - self._line(d) for d, h in points)
        spread = late[min(len(late) - 1, int(0.9 * len(late)))]
        self._error = abs(spread) + (UNKNOWN_DRIFT * span if span < DRIFT_AFTER else 0.0)


def lower_line(points: list[tuple[float, float]]) -> tuple[tuple[float, float], float]:
    """The line under all points that is nearest to them on average.

    Args:
        points: at least two (device, host) times [s] in the order of the device's.

    Returns:
        A point on it, and its slope less 1.
    """
    hull: list[tuple[float, float]] = []
    for point in points:
        while len(hull) >= 2 and _turn(hull[-2], hull[-1], point) <= 0.0:
            hull.pop()
        hull.append(point)
    middle = sum(d for d, _ in points) / len(points)
    edge = next(i for i in range(1, len(hull)) if hull[i][0] >= middle)
    (d0, h0), (d1, h1) = hull[edge - 1], hull[edge]
    return (d0, h0), ((h1 - h0) - (d1 - d0)) / (d1 - d0)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Above 0 where a, b, c turn left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
