"""T2's risk of an obstacle, kept as the paper has it; ``separation.py`` goes before it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperRisk:
    """D_risk = |v^2| / (beta D_eucl); reflexive motion when it reaches the threshold (T2).

    It says: stop at beta / 2 = 0.75 m/s^2 without any reaction time. It also fires for what moves
    away, and it never fires for what stands still close by; hence it only chooses *how* to react
    here, after separation has slowed the arm.

    Attributes:
        beta: [m/s^2] (T2: 1.5).
        threshold: reflexive at or above this (T2: 1).
    """

    beta: float = 1.5
    threshold: float = 1.0

    def risk(self, speed: float, distance: float) -> float:
        """D_risk of an obstacle with a speed relative to the robot [m/s] at a distance [m]."""
        if distance <= 0.0:
            return math.inf
        return speed * speed / (self.beta * distance)

    def reflexive(self, speed: float, distance: float) -> bool:
        """Whether the paper's robot would leave its plan."""
        return self.risk(speed, distance) >= self.threshold
