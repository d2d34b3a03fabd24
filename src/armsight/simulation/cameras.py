"""Simulated cameras: when they expose, what they deliver, and when it arrives."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.errors import DeviceError
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import CameraSpec


class SimulatedCamera:
    """Implements :class:`armsight.devices.protocols.RgbdCamera`."""

    def __init__(self, spec: CameraSpec, clock: SimulatedClock) -> None:
        self.spec = spec
        self._clock = clock
        self.reset()

    def reset(self) -> None:
        self._arrivals: deque[RgbdFrame] = deque()
        self.sequence = 0
        self.wants_color = False

    @property
    def info(self) -> RgbdCameraInfo:
        return self.spec.info

    def read(self) -> RgbdFrame | None:
        frame = None
        while self._arrivals and self._arrivals[0].arrival <= self._clock.now() + 1e-9:
            frame = self._arrivals.popleft()
        return frame

    def want_color(self, wanted: bool) -> None:
        self.wants_color = wanted

    def deliver(self, frame: RgbdFrame) -> None:
        self._arrivals.append(frame)

    def next_exposure(self) -> float:
        return self.spec.phase + self.sequence / self.spec.info.rate
