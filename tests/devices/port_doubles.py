"""Drivers that behave, and misbehave, as real ones do; each keeps what was asked of it."""

from __future__ import annotations

import threading
import time

import numpy as np

from armsight.devices.data import DepthNoise
from armsight.devices.port import (
    ArmReading,
    CameraReport,
    DepthReading,
    GripperReading,
    StereoReading,
    StereoReport,
    SwitchReading,
    WrenchReading,
)
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose

LENS = PinholeCamera(32, 24, 30.0, 30.0, 15.5, 11.5)
FOREVER = threading.Event()
"""Never set: what waits for it hangs."""


def hang():
    FOREVER.wait(60.0)


class Log:
    """Every call of every double, in order."""

    def __init__(self):
        self.calls = []

    def count(self, what):
        return sum(call[0] == what for call in self.calls)


class ArmDouble:
    """Integrates velocities; ``hangs`` names calls that never return."""

    def __init__(self, settings, log, hangs=(), n=6, epoch=5000.0):
        self.log, self.hangs, self.n = log, set(hangs), n
        self.epoch = epoch
        self.q, self.v, self.at = np.zeros(n), np.zeros(n), time.perf_counter()
        self.mode, self.speed, self.message = "running", 1.0, ""
        self.effort = None
        self.shape, self.lie, self.raises = (n,), lambda t: t, None
        self.settings = settings
        log.calls.append(("open", settings))
        if "open" in self.hangs:
            hang()

    def read(self):
        if "read" in self.hangs:
            hang()
        if self.raises is not None:
            raise self.raises
        now = time.perf_counter()
        self.q = self.q + (now - self.at) * self.v
        self.at = now
        q = np.resize(self.q, self.shape)
        stamp = self.lie(self.epoch + now)
        return ArmReading(
            stamp,
            q,
            np.resize(self.v, self.shape),
            self.effort,
            self.mode,
            self.speed,
            self.message,
        )

    def command_velocity(self, velocity):
        self.log.calls.append(("command", velocity))
        if "command" in self.hangs:
            hang()
        if self.mode != "running":
            raise DeviceError(f"refused: {self.mode}")
        self.v = velocity

    def stop(self):
        self.log.calls.append(("stop", None))
        self.v = np.zeros(self.n)
        if "stop" in self.hangs:
            hang()

    def close(self):
        self.log.calls.append(("close", None))
        if "close" in self.hangs:
            hang()


class CameraDouble:
    """Frames at 50 Hz on a clock of its own."""

    report = CameraReport(
        "double 1", LENS, 50.0, (0.2, 4.0), DepthNoise(0.001, 0.0, 0.002), 0.0, LENS
    )

    def __init__(self, settings, log, hangs=(), waits=True, change=lambda reading: reading):
        self.log, self.hangs, self.waits, self.change = log, set(hangs), waits, change
        self.count, self.raises, self.color, self.infrared = 0, None, False, False
        log.calls.append(("open", settings))
        if "open" in self.hangs:
            hang()

    def read(self):
        if "read" in self.hangs:
            hang()
        if self.raises is not None:
            raise self.raises
        if self.waits:
            time.sleep(0.02)
        self.count += 1
        depth = np.full((24, 32), 1.5, np.float32)
        depth[0, 0] = 0.0
        color = np.full((24, 32, 3), 7, np.uint8) if self.color else None
        infrared = np.full((48, 64), 9, np.uint8) if self.infrared else None
        stamp = 900.0 + time.perf_counter()
        return self.change(DepthReading(stamp, depth, color, infrared=infrared))

    def want_color(self, wanted):
        self.color = wanted

    def want_infrared(self, wanted):
        self.infrared = wanted

    def close(self):
        self.log.calls.append(("close", None))
        if "close" in self.hangs:
            hang()


class StereoDouble:
    report = StereoReport("pair 1", LENS, LENS, make_pose(None, (0.06, 0.0, 0.0)), 20.0, 0.0)

    def __init__(self, settings, log):
        log.calls.append(("open", settings))

    def read(self):
        time.sleep(0.02)
        picture = np.full((24, 32, 3), 9, np.uint8)
        return StereoReading(None, picture, picture + 1)

    def close(self):
        pass


class WrenchDouble:
    def __init__(self, settings, log):
        self.told = np.array([1.0, 2.0, 3.0])
        log.calls.append(("open", settings))

    def read(self):
        return WrenchReading(time.perf_counter(), self.told, -self.told)

    def close(self):
        pass


class SwitchDouble:
    """On from the ``connection``'s ``on_at`` to ``off_at`` seconds after it was opened."""

    def __init__(self, settings, log):
        self.began, self.settings = time.perf_counter(), settings
        log.calls.append(("open", settings))

    def read(self):
        after = time.perf_counter() - self.began
        told = self.settings.connection
        return SwitchReading(None, told.get("on_at", 1e9) <= after < told.get("off_at", 1e9))

    def close(self):
        pass


class GripperDouble:
    def __init__(self, settings, log):
        self.width, self.log = settings.opening, log
        log.calls.append(("open", settings))

    def read(self):
        return GripperReading(None, self.width)

    def move(self, width):
        self.log.calls.append(("move", width))
        self.width = width

    def close(self):
        pass
