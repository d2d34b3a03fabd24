"""The charging paper's way of plugging in, as the baseline."""

from __future__ import annotations

import numpy as np

from armsight.charging.insert import Answer, Felt, InsertOptions, Phase


class PaperInsertion:
    """The charging paper's third step: along Z at 2 % speed, halted by force or torque."""

    def __init__(
        self,
        options: InsertOptions | None = None,
        speed: float = 0.01,
        force: float = 60.0,
        torque: float = 8.0,
    ) -> None:
        self.options = options or InsertOptions()
        self.phase = Phase.INSERT
        self.words = ""
        self.tries = 0
        self._speed, self._force, self._torque = speed, force, torque

    def step(self, felt: Felt) -> Answer:
        """One tick."""
        o = self.options
        depth = o.depth + float(felt.T_seat_plug[2, 3])
        force, torque = np.linalg.norm(felt.wrench[:3]), np.linalg.norm(felt.wrench[3:])
        if self.phase is Phase.INSERT and (force > self._force or torque > self._torque):
            # what the paper calls a success: it came to a halt in the socket
            self.phase = Phase.SEATED if depth > o.captured else Phase.FAILED
            self.words = f"halted at {1e3 * depth:.1f} mm"
        twist = np.zeros(6)
        if self.phase is Phase.INSERT:
            twist[2] = self._speed
        return Answer(twist, self.phase, self.words, depth)
