"""Admittance behind a delay: forces in, a twist out, damped so that contact does not swing.

A velocity-controlled arm that presses on something of stiffness K a time T' after it was told to
overshoots by less than a tenth if its velocity is (wanted - measured force) / D with D = 2 K T';
below 0.7 K T' it is unstable (measured, docs/charging.md). So damping follows from the delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats


@dataclass(frozen=True)
class Admittance:
    """What the contact is like, and how fast the plug may move.

    Attributes:
        stiffness: of the mount along and about its axes [N/m], [N m/rad].
        delay: from a force to the motion that answers it: command, sensor and half a period [s].
        speed: greatest, linear [m/s] and angular [rad/s].
        acceleration: greatest, linear [m/s^2] and angular [rad/s^2].
    """

    stiffness: tuple[float, float] = (5000.0, 30.0)
    delay: float = 0.072
    speed: tuple[float, float] = (0.025, 0.3)
    acceleration: tuple[float, float] = (0.4, 4.0)

    @property
    def damping(self) -> tuple[float, float]:
        """D = 2 K T', linear [N s/m] and angular [N m s/rad]."""
        return 2.0 * self.stiffness[0] * self.delay, 2.0 * self.stiffness[1] * self.delay

    def answer(self, wrench: Floats, wanted: Floats) -> Floats:
        """(6,) twist that lets a plug yield to a wrench on it until that is minus the wanted one.

        Args:
            wrench: (6,) of the surroundings on the plug [N], [N m].
            wanted: (6,) that the plug shall press with.
        """
        return np.asarray((wrench + wanted) / np.repeat(self.damping, 3))

    def limited(self, twist: Floats, last: Floats, dt: float) -> Floats:
        """A twist within the limits of speed, and of acceleration from the last one."""
        out = twist.copy()
        for k in range(2):
            part = slice(3 * k, 3 * k + 3)
            out[part] = _shortened(out[part], self.speed[k])
            out[part] = last[part] + _shortened(out[part] - last[part], self.acceleration[k] * dt)
        return out

    def deflection(self, wrench: Floats) -> Floats:
        """(6,) how far the mount gives way under a wrench [m], [rad]."""
        return np.asarray(wrench / np.repeat(self.stiffness, 3))


def _shortened(vector: Floats, most: float) -> Floats:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)
