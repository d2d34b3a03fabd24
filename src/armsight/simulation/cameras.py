"""Simulated cameras: when they expose, what they deliver, and when it arrives."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import CameraSpec


class SimulatedCamera:
    """Implements :class:`armsight.devices.protocols.RgbdCamera`."""

    def __init__(self, spec: CameraSpec, clock: SimulatedClock) -> None:
        self.spec = spec
        self.T_mount_camera = spec.T_mount_camera_true
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

    def expose(self, now, T, data, renderer):
        info = self.info
        shot = renderer.take(data, T, info.depth)
        depth = renderer.depth(shot, info.depth).depth
        low, high = info.range
        depth[(depth < low) | (depth > high)] = np.nan
        color = None
        if self.wants_color and info.color is not None:
            renderer.aim(shot, T @ info.T_depth_color, info.color)
            color = renderer.color(shot, info.color)
        renderer.give_back(shot)
        self.deliver(RgbdFrame(info.name, self.sequence, now, now + info.latency, depth, color))
        self.sequence += 1

    def deliver(self, frame: RgbdFrame) -> None:
        self._arrivals.append(frame)

    def next_exposure(self) -> float:
        return self.spec.phase + self.sequence / self.spec.info.rate
