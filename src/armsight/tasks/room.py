"""Where the guard lets an arm stand, as far as the newest map knows."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from armsight.arrays import JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot

AWAY = 0.56
"""From whoever may be somewhere; the guard lets an arm rest at 0.52 m [m]."""
STEP = 0.25
"""A way is looked at after every so much of a joint's turn [rad]."""


class Room:
    """Where the guard lets an arm stand: it keeps its distance from whoever may be somewhere.

    Attributes:
        snapshot: the newest map, or None.
        here: (n,) where the arm is [rad], or None.
    """

    def __init__(self, robot: Robot) -> None:
        self.snapshot: WorkspaceSnapshot | None = None
        self.here: JointVector | None = None
        self._robot, self._moves = robot, np.asarray(robot.spheres.link) > 0
        self._hazards: tuple[int, KDTree] | None = None

    def left(self, joints: JointVector) -> float:
        """How much farther than that (n,) [rad] are from all that may be somebody [m]."""
        snapshot, moves = self.snapshot, self._moves
        if snapshot is None or not len(snapshot.hazards):
            return np.inf
        if self._hazards is None or self._hazards[0] != snapshot.sequence:
            self._hazards = snapshot.sequence, KDTree(snapshot.hazards)
        centers = sphere_centers(self._robot, joints)[moves]
        reach = np.asarray(self._robot.spheres.radius)[moves] + snapshot.hazard_radius + AWAY
        near, _ = self._hazards[1].query(centers)
        return float((near - reach).min())

    def on_way(self, joints: JointVector) -> float:
        """The least room on the straight way from where the arm is to (n,) [rad], in metres.

        An arm that stands where it has too little may go where it has no less.
        """
        here = self.here
        if here is None:
            return np.inf
        steps = int(np.ceil(np.abs(joints - here).max() / STEP)) + 1
        left = [self.left(here + share * (joints - here)) for share in np.linspace(0, 1, steps)]
        return min(left) - min(left[0], 0.0)
