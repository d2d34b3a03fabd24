"""What of the arm may not rise higher while its tip is led: the top of what is mapped.

Close under the top the arm hides what no camera sees from elsewhere; the guard keeps away from what
may be there, on all sides, and the arm stands there. So under a ceiling the tool points otherwise
before the arm rises, and where that does not do, the tip stays behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot

BELOW = 0.05
"""The arm keeps so far below the top of the mapped box [m]."""
NEAR, LEAST, HARD = 0.03, 0.05, 30.0
"""From so far below a ceiling on [m] the tool's direction counts less, at the ceiling by this share
only; what is too high counts so much more than the tip's way."""
RISES = 4.0
"""The arm rises no faster than this times the room that it has [1/s]."""


@dataclass(frozen=True)
class Ceiling:
    """A height that no part beyond the first link passes: that one turns about the vertical.

    Attributes:
        up: (3,) unit, in ``base``.
        height: along it, from the origin of ``base`` [m].
    """

    up: Vector3
    height: float

    def above(self, robot: Robot) -> Ceiling:
        """This one, or one that is high enough for an arm at home to move freely."""
        need = -self.under(robot, robot.home) + NEAR
        return self if need <= 0.0 else Ceiling(self.up, self.height + need)

    def under(self, robot: Robot, q: JointVector) -> float:
        """How far below it the arm stays at (n,) [rad]; below 0 above it [m]."""
        rises = np.asarray(robot.spheres.link) > 1
        high = sphere_centers(robot, q) @ self.up + robot.spheres.radius
        return self.height - float(high[rises].max(initial=-np.inf))
