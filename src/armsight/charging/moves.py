"""Where the arm goes on a visit: poses for the second look and the approach, straight lines."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.geometry.pose import inverse, log, look_at, make_pose

T_PORT_PLUG = make_pose(np.diag([-1.0, 1.0, -1.0]))
"""A plug before a port: the same up, looking at each other."""
SIDES = (90.0, 40.0, 140.0, 0.0, 180.0)
"""About the port's axis, where a second look is taken from, the first ones first: above, then to
the sides [deg]."""
GAIN = 1.5
"""Of a straight line's end [1/s]."""


def before_port(T_base_port: Pose, distance: float) -> Pose:
    """``T_base_plug`` of a plug that looks at a port from a distance [m]; negative is inside."""
    return np.asarray(T_base_port @ T_PORT_PLUG @ make_pose(None, (0.0, 0.0, -distance)))


def looking_pose(T_base_port: Pose, distance: float, aside: float, side: int) -> Pose:
    """``T_base_camera`` that looks at a port off its axis, the picture upright.

    Args:
        T_base_port: about where it is.
        distance: from it [m].
        aside: off its axis [rad].
        side: place in :data:`SIDES`.
    """
    turn = np.deg2rad(SIDES[side % len(SIDES)])
    away = np.array([np.sin(aside) * np.cos(turn), np.sin(aside) * np.sin(turn), np.cos(aside)])
    eye = T_base_port[:3, 3] + distance * T_base_port[:3, :3] @ away
    up = [float(v) for v in T_base_port[:3, 1]]
    return look_at(eye, T_base_port[:3, 3], up)


def straight(T_base_plug: Pose, T_base_goal: Pose, speed: float, turning: float = 0.25) -> Floats:
    """(6,) twist of the plug in its axes towards a goal, first across, then along its axis.

    Args:
        T_base_plug: where it is.
        T_base_goal: where it shall be.
        speed: greatest [m/s].
        turning: greatest [rad/s].
    """
    error = log(inverse(T_base_plug) @ T_base_goal)
    across = float(np.linalg.norm(error[:2])) + 0.05 * float(np.linalg.norm(error[3:]))
    twist = GAIN * error
    twist[2] *= max(0.0, 1.0 - across / 0.006)
    for part, most in ((slice(0, 3), speed), (slice(3, 6), turning)):
        size = float(np.linalg.norm(twist[part]))
        twist[part] *= min(1.0, most / max(size, 1e-12))
    return np.asarray(twist)


def apart(T_base_plug: Pose, T_base_goal: Pose) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    error = log(inverse(T_base_plug) @ T_base_goal)
    return float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
