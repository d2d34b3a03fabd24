"""Where the guard lets an arm stand, as far as the newest map knows."""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards, SeparationView
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots.robot import Robot

RESTS = 0.52
"""From whoever may be somewhere the guard lets an arm rest, where nobody says how far [m]."""
BESIDE = 0.04
"""Room is what is more than that by so much [m]."""
STEP = 0.25
"""A way is looked at after every so much of a joint's turn [rad]."""
RATE, CREEPS = 0.65, 0.005
"""Beside whoever may be somewhere the arm is as fast as this much of what it has more than it needs
at rest [1/s], counted as so much at least [m] (measured: 0.07 m/s at 0.64 m, 0.011 at 0.54)."""


class Room:
    """Where the guard lets an arm stand: it keeps its distance from whoever may be somewhere.

    Attributes:
        snapshot: the newest map, or None.
        here: (n,) where the arm is [rad], or None.
        rests: how far from whoever may be somewhere the guard lets the arm rest [m].
    """

    def __init__(self, robot: Robot) -> None:
        self.snapshot: WorkspaceSnapshot | None = None
        self.here: JointVector | None = None
        self.rests = RESTS
        self._monitor = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
        self._hazards: tuple[int, Hazards] | None = None

    def left(self, joints: JointVector) -> float:
        """How much farther than needed (n,) [rad] are from all that may be somebody [m]."""
        view = self._at(joints)
        return np.inf if view is None else self._left(view)

    def lasts(self, joints: JointVector) -> float:
        """How long the straight way from where the arm is to (n,) [rad] lasts at least [s].

        So near to who may be somewhere as it leads, the guard makes the arm slow; inf where it
        leads nearer than the guard lets it be. An arm that stands where it has too little room may
        go where it has no less.
        """
        views = [] if self.here is None else [self._at(q) for q in self._way(joints)]
        seen = [view for view in views if view is not None]
        if not seen:
            return 0.0
        left = np.array([self._left(view) for view in seen])
        if left.min() < min(left[0], 0.0):
            return np.inf
        centers = np.array([view.center for view in seen])
        far = np.linalg.norm(np.diff(centers, axis=0), axis=2).max(axis=1)
        least = np.minimum(left[1:], left[:-1]) + BESIDE
        return float((far / (RATE * np.maximum(least, CREEPS))).sum())

    def _at(self, joints: JointVector) -> SeparationView | None:
        """How far hazards are from the arm at (n,) [rad]; None: there are none."""
        snapshot = self.snapshot
        if snapshot is None or not len(snapshot.hazards):
            return None
        if self._hazards is None or self._hazards[0] != snapshot.sequence:
            self._hazards = snapshot.sequence, Hazards.of(snapshot)
            self._monitor.set_reaction(0.0, snapshot.hazard_radius)
        return self._monitor.at_rest(joints, self._hazards[1])

    def _left(self, view: SeparationView) -> float:
        return view.least - self.rests - BESIDE

    def _way(self, joints: JointVector) -> JointPath:
        """(k, n) on the straight way from where the arm is."""
        assert self.here is not None
        steps = int(np.ceil(np.abs(joints - self.here).max() / STEP)) + 1
        return self.here + np.linspace(0.0, 1.0, max(steps, 2))[:, None] * (joints - self.here)
