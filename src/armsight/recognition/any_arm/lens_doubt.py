"""What is not known of a lens is not known of the arm's distance.

A focal length that is a tenth too long puts the arm a tenth too far away, however well it fits.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.recognition.any_arm.sighting import Arm, Intrinsics

DOUBT: dict[Intrinsics, float] = {"given": 0.0, "exif": 0.05, "assumed": 0.25}
"""Standard deviation of a focal length, as a share of it. Pictures' files round theirs; lenses of
usual cameras see 50 to 80 deg where 65 is assumed."""
RIGHT = 0.1
"""Mean error of joints that are right, as trust has it [m]."""


def doubted(arm: Arm, source: Intrinsics, threshold: float) -> Arm:
    """An arm with the lens's share in its covariance, believed only if the lens is known for it.

    Args:
        arm: seen through a lens that is taken as right.
        source: where the lens is from.
        threshold: of trust, from which an answer is believed.
    """
    share = DOUBT[source]
    if not share or arm.T_camera_base is None:
        return arm
    along = share * arm.joints[:, 2]
    covariance = arm.covariance.copy()
    covariance[:, 2, 2] += along**2
    off = float(np.abs(along).mean())
    sure = arm.trust * math.erf(RIGHT / max(off, 1e-9) / math.sqrt(2.0))
    if not arm.believed or sure >= threshold:
        return replace(arm, covariance=covariance)
    known = "not known" if source == "assumed" else "only roughly known from the picture's own file"
    problem = (
        f"its lens is {known}, which leaves {1e3 * off:.0f} mm open (through the right one "
        f"{100.0 * arm.trust:.0f} % sure that joints are right to 10 cm); "
        "give --camera or --intrinsics"
    )
    return replace(arm, covariance=covariance, believed=False, problem=problem)
