"""When a simulated camera exposes, and when its frames arrive."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.errors import DeviceError
from armsight.simulation.camera_faults import Faults
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import CameraSpec


@dataclass
class Delivery:
    """A frame on its way."""

    sequence: int
    stamp: float
    arrival: float
    picture: Future[Any]


class Deliveries:
    """Frames on their way to the computer; a reader gets the newest that has arrived."""

    def __init__(self) -> None:
        self._queue: deque[Delivery] = deque()
        self._read = -1

    def add(self, delivery: Delivery, now: float, cancel: bool) -> None:
        """Send a frame; those that nobody will read any more are forgotten."""
        while len(self._queue) > 1 and self._queue[1].arrival <= now:
            stale = self._queue.popleft()
            if cancel:
                stale.picture.cancel()
        self._queue.append(delivery)

    def newest(self, now: float) -> Delivery | None:
        """The newest frame that has arrived and is newer than the last one read."""
        arrived = [d for d in self._queue if d.arrival <= now + 1e-9 and d.sequence > self._read]
        if not arrived:
            return None
        best = max(arrived, key=lambda d: d.sequence)
        self._read = best.sequence
        self._queue = deque(d for d in self._queue if d.sequence > best.sequence)
        return best


class Timing:
    """Exposure times, stamps and arrivals of a camera, with the faults that change them."""

    def __init__(self, spec: CameraSpec, clock: SimulatedClock, seed: tuple[int, ...]) -> None:
        self.spec = spec
        self.clock = clock
        self.faults = Faults()
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Back to time 0."""
        self.sequence = 0
        self._rng = np.random.default_rng(self._seed)

    @property
    def next_exposure(self) -> float:
        """When the shutter opens next [s]."""
        return self.spec.phase + self.sequence / self.spec.info.rate

    def expose(self, now: float) -> tuple[int, float, float] | None:
        """Number, stamp and arrival of an exposure at ``now`` [s], or None when it is lost."""
        sequence = self.sequence
        self.sequence += 1
        chance, jitter = self._rng.uniform(-1.0, 1.0, 2)
        if self.faults.find("fail", now) or self.faults.find("lost", now):
            return None
        drop = self.faults.find("drop", now)
        if drop is not None and 0.5 * (chance + 1.0) < drop.amount:
            return None
        delay = self.faults.find("delay", now)
        late = delay.amount if delay is not None else 0.0
        stamp = now + self.spec.stamp_jitter * jitter
        return sequence, stamp, now + self.spec.info.latency + late

    def check(self) -> None:
        """Raise when the camera is lost."""
        if self.faults.find("lost", self.clock.now()):
            raise DeviceError(f"camera '{self.spec.info.name}' is lost (no answer on its bus)")
