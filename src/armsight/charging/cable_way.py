"""Whether a plug's hung cable reaches a port, and hangs beside the car rather than in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Pose
from armsight.charging.moves import before_port
from armsight.geometry.pose import inverse, transform
from armsight.geometry.shapes import Solid
from armsight.robots.cable import HungCable

SPARE = 0.05
"""A cable that is stretched to less than this of its length is not led there [m]."""
DEEP = 0.05
"""It hangs still as far as this from its curve [m]: what lies deeper in the car is in it."""
BEFORE = (0.10, 0.0)
"""Places of the plug's tip before the port that are looked at [m]."""


def cable_fault(cable: HungCable, T_base_port: Pose, body: Sequence[Solid] = ()) -> str:
    """Why the cable of a plug cannot be led to a port, in words; empty where it can.

    Args:
        cable: from the plug to its hanger.
        T_base_port: where the port is.
        body: the car's, in the port's frame.
    """
    for before in BEFORE:
        end = transform(before_port(T_base_port, before), np.array([cable.root]))[0]
        away = float(np.linalg.norm(end - np.array(cable.hanger)))
        if away > cable.length - SPARE:
            return (
                f"the cable's hanger is {away:.2f} m from the plug at the port, the cable "
                f"{cable.length:.2f} m long: too short"
            )
        points = transform(inverse(T_base_port), cable.still(end))
        deepest = min((float(s.distance(points).min()) for s in body), default=np.inf)
        if deepest < -DEEP:
            return (
                f"the cable would hang {-100 * deepest:.0f} cm deep in the car: hang it up on the "
                "other side, or park otherwise"
            )
    return ""
