"""The lab's arm: first-order drives, a watchdog of its own, a clock in milliseconds."""

import threading
import time

import numpy as np

from armsight.devices.port import ArmReading, ArmSettings


class Arm:
    """Six joints that follow their commanded speeds."""

    def __init__(self, settings: ArmSettings) -> None:
        self.settings = settings
        self.lock = threading.Lock()
        self.position = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
        self.velocity, self.wanted = np.zeros(6), np.zeros(6)
        self.heard = self.at = time.monotonic()

    def read(self) -> ArmReading:
        """Where it is now."""
        with self.lock:
            now = time.monotonic()
            if now > self.heard + self.settings.watchdog:
                self.wanted = np.zeros(6)
            step = self.settings.acceleration * (now - self.at)
            self.velocity = self.velocity + np.clip(self.wanted - self.velocity, -step, step)
            self.position = self.position + (now - self.at) * self.velocity
            self.at = now
            return ArmReading(1e-3 * round(1e3 * now, 3), self.position, self.velocity)

    def command_velocity(self, velocity: np.ndarray) -> None:
        """Follow these speeds."""
        with self.lock:
            self.wanted, self.heard = velocity, time.monotonic()

    def stop(self) -> None:
        """Brake."""
        self.command_velocity(np.zeros(6))

    def close(self) -> None:
        """Nothing is held."""
