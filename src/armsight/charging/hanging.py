"""A plug that hangs in a soft mount: where it is by what the force sensor says, and how to move it.

The mount's centre of turning is the tool's nominal tip. What acts on the plug (weight, cable,
contact) is what the sensor reads; the mount gives way by that over its stiffness.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.admittance import Admittance
from armsight.geometry.pose import exp, inverse
from armsight.robots.soft_mount import at_plug


def hung(T_flange_tip: Pose, wrench: Floats, mount: Admittance) -> Pose:
    """``T_flange_plug`` of a plug that its weight and cable have bent out of the nominal place.

    Args:
        T_flange_tip: where it is when nothing acts on it.
        wrench: (6,) of the sensor, *not* tared.
        mount: whose stiffness counts.
    """
    return np.asarray(T_flange_tip @ exp(mount.deflection(at_plug(wrench, T_flange_tip))))


def tip_twist(twist: Floats, T_flange_tip: Pose, T_flange_plug: Pose) -> Floats:
    """(6,) twist of the tool's nominal tip in its axes, for one of the plug's origin in its own."""
    T = inverse(T_flange_tip) @ T_flange_plug
    turn = T[:3, :3] @ twist[3:]
    return np.concatenate([T[:3, :3] @ twist[:3] - np.cross(turn, T[:3, 3]), turn])
