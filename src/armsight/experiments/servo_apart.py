"""How far an arm is from somebody, and where it may begin before them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

from armsight.arrays import JointVector, Points
from armsight.robots.kinematics import sphere_centers, tcp_pose
from armsight.robots.robot import Robot

KEPT = 0.45
"""The arm begins at least so far from somebody [m]: nearer its guard would hold it."""


def apart(robot: Robot, q: JointVector, skin: Points, reach: float = 0.0) -> float:
    """Distance of an arm at (n,) [rad] from somebody's skin (k, 3), the ball left out [m].

    So much of the tool, from its tip, may touch and does not count: ``reach`` [m].
    """
    center, radius = sphere_centers(robot, q), robot.spheres.radius
    tip = tcp_pose(robot, q)[:3, 3]
    counts = np.linalg.norm(center - tip, axis=1) + radius > reach
    away, _ = cKDTree(skin).query(center[counts])
    return float((away - radius[counts]).min())


def first_apart(
    robot: Robot,
    starts: Iterable[JointVector],
    skin: Points,
    kept: float = KEPT,
    reach: float = 0.0,
) -> JointVector:
    """(n,) the first joints that keep so far from somebody's skin (k, 3); else the farthest.

    Args:
        robot: the arm.
        starts: (n,) joints each [rad], one at least.
        skin: in ``base`` [m].
        kept: how far [m].
        reach: so much of the tool, from its tip, may touch [m].
    """
    farthest, most = robot.home, -math.inf
    for start in starts:
        away = apart(robot, start, skin, reach)
        if away > kept:
            return start
        if away > most:
            farthest, most = start, away
    return farthest
