"""A plug that charges goes where its socket goes: a car settles, is leaned on, is pushed."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.geometry.pose import inverse

LED = 20.0
"""Who presses the plug, or draws it, by so much more than when it came to rest, leads it [N] ..."""
TWISTED = 2.5
"""... or turns it by so much more [N m]."""
CALM = 1.5
"""The arm goes along until nobody has led it for so long [s]."""
FARTHEST = 0.03
"""It goes no farther than this from where it was seated [m]: what is left is the guard's."""


class GoingAlong:
    """Tells when a plug at rest is led, and by what it went along."""

    def __init__(self) -> None:
        self._felt: Floats | None = None
        self._T_seated = self._T_rest = np.eye(4)
        self._led = -np.inf

    def step(self, now: float, wrench: Floats | None, T_base_plug: Pose) -> Pose | None:
        """One round of a plug in its socket.

        Args:
            now: [s].
            wrench: (6,) on the plug [N], [N m]; None where nobody feels.
            T_base_plug: where it is.

        Returns:
            (4, 4) motion in ``base`` since it last rested, once it rests again after it was led.
        """
        if wrench is None:
            return None
        if self._felt is None:
            self._felt, self._T_seated, self._T_rest = wrench, T_base_plug, T_base_plug
        more = wrench - self._felt
        over = np.linalg.norm(more[:3]) > LED or np.linalg.norm(more[3:]) > TWISTED
        if over and self._far(T_base_plug) < FARTHEST:
            self._led = now
        elif np.isfinite(self._led) and not self.led(now, T_base_plug):
            T = T_base_plug @ inverse(self._T_rest)
            self._felt, self._T_rest, self._led = wrench, T_base_plug, -np.inf
            return T
        return None

    def led(self, now: float, T_base_plug: Pose) -> bool:
        """Whether the arm should go along at ``now`` [s]."""
        return now - self._led < CALM and self._far(T_base_plug) < FARTHEST

    def _far(self, T_base_plug: Pose) -> float:
        return float(np.linalg.norm(T_base_plug[:3, 3] - self._T_seated[:3, 3]))
