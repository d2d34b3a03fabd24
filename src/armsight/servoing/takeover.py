"""The place that is servoed to goes on where a look corrects it; where the target went, it jumps.

The pair sees a target to a millimetre that the fixed cameras had predicted to a few, and each look
corrects a prediction over a tenth of a second: by 2.5 mm in the median, 6 mm where the pair takes
over. That is right, and passed on within a few rounds instead of at once.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Vector3
from armsight.servoing.estimate import TargetEstimate

FADES = 0.025
"""What is held back is passed on within about this time [s]."""
MOST = 0.01
"""No more than this is held back [m]: what corrects more has seen the target go elsewhere."""


class Takeover:
    """Holds back what a look corrects, whoever looked.

    Attributes:
        held: (3,) from the estimate to the place that is servoed to [m].
    """

    def __init__(self) -> None:
        self.held: Vector3 = np.zeros(3)
        self._estimate: TargetEstimate | None = None
        self._now = -math.inf

    def update(self, now: float, estimate: TargetEstimate) -> Vector3:
        """What is held back at a time [s] of the newest estimate, (3,) [m]."""
        before = self._estimate
        if before is not None:
            held = self.held + before.at(now)[0] - estimate.at(now)[0]
            self.held = held * math.exp(-(now - self._now) / FADES)
            if float(held @ held) > MOST**2:
                self.held = np.zeros(3)
        self._estimate, self._now = estimate, now
        return self.held
