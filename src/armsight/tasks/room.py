"""Where the guard lets an arm stand, as far as the newest map knows."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from armsight.arrays import JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot

AWAY = 0.56
"""From whoever may be somewhere; the guard lets an arm rest at 0.52 m [m]."""
STEP = 0.25
"""A way is looked at after every so much of a joint's turn [rad]."""
RATE, CREEPS = 0.65, 0.005
"""Beside whoever may be somewhere the arm is as fast as this much of what it has more than the
guard's 0.52 m [1/s], counted as so much at least [m] (measured: 0.07 m/s at 0.64 m, 0.011 at 0.54).
"""
RESTS = 0.52
"""See :data:`AWAY` [m]."""


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
        if self.here is None:
            return np.inf
        left = [self.left(q) for q in self._way(joints)]
        return min(left) - min(left[0], 0.0)

    def lasts(self, joints: JointVector) -> float:
        """How long the straight way from where the arm is to (n,) [rad] lasts at least [s].

        So near to who may be somewhere as it leads, the guard makes the arm slow.
        """
        if self.here is None or self.snapshot is None:
            return 0.0
        way = self._way(joints)
        centers = np.array([sphere_centers(self._robot, q)[self._moves] for q in way])
        far = np.linalg.norm(np.diff(centers, axis=0), axis=2).max(axis=1)
        left = np.array([self.left(q) for q in way]) + AWAY - RESTS
        return float((far / (RATE * np.maximum(np.minimum(left[1:], left[:-1]), CREEPS))).sum())

    def _way(self, joints: JointVector) -> JointPath:
        """(k, n) on the straight way from where the arm is."""
        assert self.here is not None
        steps = int(np.ceil(np.abs(joints - self.here).max() / STEP)) + 1
        return self.here + np.linspace(0.0, 1.0, max(steps, 2))[:, None] * (joints - self.here)
