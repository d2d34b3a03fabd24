"""The simulated force sensor: what MuJoCo computes at the flange, as a real one would tell it."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.arrays import Floats
from armsight.devices.data import Wrench
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.spec import WrenchSpec


class SimulatedWrench:
    """Implements :class:`armsight.devices.protocols.ForceSensor`.

    A first-order low-pass, a constant bias drawn from the seed, one that wanders, white noise,
    saturation, and a latency. Every reading is handed over, in order.
    """

    def __init__(
        self, spec: WrenchSpec, clock: SimulatedClock, time_step: float, seed: tuple[int, ...]
    ) -> None:
        self._spec = spec
        self._clock = clock
        self._seed = seed
        self._gain = 1.0 - np.exp(-2.0 * np.pi * spec.low_pass * time_step)
        self._every = max(1, round(1.0 / (spec.rate * time_step)))
        self._scale = np.repeat(spec.noise, 3)
        self._wander = np.repeat(spec.drift, 3) * np.sqrt(self._every * time_step / 60.0)
        self._greatest = np.repeat(spec.greatest, 3)
        self.bias = np.random.default_rng((*seed, 1)).standard_normal(6) * np.repeat(spec.bias, 3)
        self.reset()

    def reset(self) -> None:
        """Back to time 0."""
        self._rng = np.random.default_rng((*self._seed, 2))
        self._filtered: Floats | None = None
        self._drift = np.zeros(6)
        self._waiting: deque[Wrench] = deque(maxlen=4096)

    def read(self) -> Wrench | None:
        """The oldest reading that has arrived and was not handed over yet, or None."""
        limit = self._clock.now() - self._spec.latency + 1e-9
        if self._waiting and self._waiting[0].stamp <= limit:
            return self._waiting.popleft()
        return None

    def sense(self, step: int, now: float, force: Floats, torque: Floats) -> None:
        """Take in what acts on the flange after a physics step, in the flange's frame.

        Args:
            step: number of the step.
            now: its end [s].
            force: (3,) [N].
            torque: (3,) about the flange's origin [N m].
        """
        true = np.concatenate([force, torque])
        if self._filtered is None:
            self._filtered = true
        self._filtered = self._filtered + self._gain * (true - self._filtered)
        if step % self._every == 0:
            self._drift = self._drift + self._rng.standard_normal(6) * self._wander
            told = self._filtered + self.bias + self._drift
            told = told + self._rng.standard_normal(6) * self._scale
            told = np.clip(told, -self._greatest, self._greatest)
            self._waiting.append(Wrench(now, told[:3], told[3:]))
