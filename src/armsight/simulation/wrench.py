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

    A first-order low-pass, a constant bias drawn from the seed, white noise, and a latency.
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
        self.bias = np.random.default_rng((*seed, 1)).standard_normal(6) * np.repeat(spec.bias, 3)
        self.reset()

    def reset(self) -> None:
        """Back to time 0."""
        self._rng = np.random.default_rng((*self._seed, 2))
        self._filtered: Floats | None = None
        self._waiting: deque[Wrench] = deque(maxlen=4096)

    def read(self) -> Wrench | None:
        """The newest reading that has arrived since the last call, or None."""
        newest = None
        limit = self._clock.now() - self._spec.latency + 1e-9
        while self._waiting and self._waiting[0].stamp <= limit:
            newest = self._waiting.popleft()
        return newest

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
            told = self._filtered + self.bias + self._rng.standard_normal(6) * self._scale
            self._waiting.append(Wrench(now, told[:3], told[3:]))
