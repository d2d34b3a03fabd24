"""The lab's camera hangs under the ceiling and sees the floor; its clock counts from 1970."""

import time

import numpy as np

from armsight.devices.data import DepthNoise
from armsight.devices.port import CameraReport, CameraSettings, DepthReading
from armsight.geometry.camera import PinholeCamera

LENS = PinholeCamera(320, 240, 190.0, 190.0, 159.5, 119.5)


class Camera:
    """A time-of-flight camera that looks straight down."""

    def __init__(self, settings: CameraSettings) -> None:
        noise = DepthNoise(0.002, 0.0, 0.001)
        self.report = CameraReport("Lab ToF", LENS, 20.0, (0.3, 5.0), noise, latency=0.0)
        self.floor = float(settings.connection["height"])
        self.random = np.random.default_rng(int(settings.connection.get("seed", 0)))
        self.next = time.monotonic()

    def read(self) -> DepthReading:
        """Wait for the next exposure."""
        self.next += 0.05
        time.sleep(max(0.0, self.next - time.monotonic()))
        sigma = float(self.report.noise.sigma(np.float64(self.floor)))
        depth = self.floor + sigma * self.random.standard_normal((LENS.height, LENS.width))
        return DepthReading(time.time(), depth.astype(np.float32))

    def want_color(self, wanted: bool) -> None:
        """It has none."""

    def close(self) -> None:
        """Nothing is held."""
