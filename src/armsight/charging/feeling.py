"""What the plug feels: readings of the force sensor, their zero, and how the plug hangs."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.charging.admittance import Admittance
from armsight.charging.hanging import hung, tip_twist
from armsight.charging.visit import Seen
from armsight.motion.force_watch import FROZEN
from armsight.robots.soft_mount import at_plug

OVER = 0.35
"""A zero is the mean of readings over this time [s]."""
SAMPLES = 12
"""Fewer readings are no mean."""
STEADY = (4.0, 0.6)
"""Readings that scatter by more are no zero [N], [N m]."""
SILENT = 0.05
"""A reading older than this says nothing of now [s]."""
LIGHT, HEAVY = 0.7, 1.4
"""What is felt of a plug's weight, at least and at most."""
TUG, BRIEF = 50.0, 0.04
"""What pulls in free air by so much more than before [N], for so long [s], is no swing: moving the
plug, and turning a sensor that errs by 20 N, makes less of a difference."""


class Feeling:
    """Takes every reading in.

    Args:
        T_flange_tip: where the plug is when nothing acts on it.
        mount: that gives way.

    Attributes:
        T_flange_plug: where it is as it hangs.
        tare: (6,) of the sensor without contact; None before it was measured.
    """

    def __init__(self, T_flange_tip: Pose, mount: Admittance) -> None:
        self._T_tip, self._mount = T_flange_tip, mount
        self.T_flange_plug: Pose = T_flange_tip.copy()
        self.tare: Floats | None = None
        self._readings: deque[tuple[float, Floats]] = deque(maxlen=1000)
        self._changed, self._same = -np.inf, 0  # since when it says what it says, and how often

    def take(self, seen: Seen) -> None:
        """The newest reading, if it is new and a number."""
        wrench = seen.wrench
        if wrench is None or (self._readings and wrench.stamp <= self._readings[-1][0]):
            return
        value = np.concatenate([wrench.force, wrench.torque]).astype(float)
        if not np.isfinite(value).all():
            return
        if self._readings and np.array_equal(value, self._readings[-1][1]):
            self._same += 1
        else:
            self._changed, self._same = wrench.stamp, 0
        self._readings.append((wrench.stamp, value))

    @property
    def frozen(self) -> bool:
        """Whether the sensor repeats itself: nobody feels."""
        repeats = self._same >= SAMPLES and self._readings[-1][0] - self._changed > FROZEN
        return bool(repeats)

    def hang(self) -> None:
        """Take over how the plug hangs now; only in free air."""
        mean = self._mean()
        if mean is not None:
            self.T_flange_plug = hung(self._T_tip, mean, self._mount)

    def not_ours(self, weight: float) -> str:
        """Why what hangs here is not the plug, of a weight with its cable [N], in words; or empty.

        A plug that fell, was taken or exchanged weighs otherwise; a caught cable pulls.
        """
        mean = self._mean()
        if mean is None:
            return ""
        felt = float(np.linalg.norm(mean[:3]))
        if LIGHT * weight < felt < HEAVY * weight:
            return ""
        how = "it is missing, or another one" if felt < weight else "is its cable caught?"
        return f"the plug weighs {felt:.0f} N, with its cable {weight:.0f} are expected: {how}"

    @property
    def force(self) -> Vector3 | None:
        """(3,) all that acts on the plug, weight included, in the sensor's axes; None: unknown."""
        if not self._readings or self.frozen:
            return None
        last = self._readings[-1][0]
        recent = [value[:3] for stamp, value in self._readings if stamp > last - BRIEF]
        return np.asarray(np.mean(recent, axis=0))

    @property
    def pull(self) -> float:
        """The same without its direction [N]; NaN: unknown."""
        force = self.force
        return float("nan") if force is None else float(np.linalg.norm(force))

    def zero(self, now: float) -> bool:
        """Take over what is felt now as no contact; False where it cannot be believed."""
        mean = self._mean()
        if mean is None or self.contact(now, np.zeros(6)) is None:
            return False
        self.hang()
        self.tare = mean
        return True

    def contact(self, now: float, tare: Floats | None = None) -> Floats | None:
        """(6,) of contact on the plug, about its origin, in its axes; None where nobody feels."""
        tare = self.tare if tare is None else tare
        if tare is None or not self._readings or self.frozen:
            return None
        if now - self._readings[-1][0] > SILENT:
            return None
        return at_plug(self._readings[-1][1] - tare, self.T_flange_plug)

    def silent(self, now: float) -> float:
        """How long ago the newest reading was taken that said anything new of now [s]."""
        if not self._readings:
            return np.inf
        return now - (self._changed if self.frozen else self._readings[-1][0])

    def give(self, now: float) -> float:
        """How far contact has moved the plug along its axis [m]."""
        felt = self.contact(now)
        return 0.0 if felt is None else float(self._mount.deflection(felt)[2])

    def tip_twist(self, twist: Floats) -> Floats:
        """(6,) twist of the tool's nominal tip for one of the plug."""
        return tip_twist(twist, self._T_tip, self.T_flange_plug)

    def _mean(self) -> Floats | None:
        if not self._readings or self.frozen:
            return None
        last = self._readings[-1][0]
        recent = np.array([value for stamp, value in self._readings if stamp > last - OVER])
        if len(recent) < SAMPLES:
            return None
        spread = recent.std(axis=0)
        if spread[:3].max() > STEADY[0] or spread[3:].max() > STEADY[1]:
            return None
        return np.asarray(recent.mean(axis=0))
