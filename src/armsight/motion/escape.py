"""The way out of a start that touches something by a little: noise, or something came too near."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.depth_kernels import sink
from armsight.motion.kernels import body_centers, self_clearance, sphere_clearances

DEPTH = 0.05
"""Deepest contact [m] that is left without help: a voxel, and what link spheres overshoot. What
touched the arm and went away again stays in the map there, hidden by the arm itself, until the arm
has moved. Deeper contacts need a person."""
SPREADS = (0.03, 0.06, 0.12, 0.25, 0.4)
"""How far away [rad] free places are sought, one after the other."""
TRIES = 80
"""Directions tried at each distance."""
STEP = 0.002
"""Longest step [m] of the fastest sphere between two looks on the way out."""
SLACK = 1e-4
"""A drive that follows a way out may be this much off it [m]."""


def escape(
    model: CollisionModel, q: JointVector, snapshot: WorkspaceSnapshot, rng: np.random.Generator
) -> JointVector | None:
    """A free configuration near q that is reached by :func:`leaves`; or None."""
    if not model.within_limits(q):
        return None
    touch = _Touch(model, q, snapshot)
    if touch.depth > DEPTH:
        return None
    for spread in SPREADS:
        for _ in range(TRIES):
            way = rng.normal(size=len(q))
            goal = model.inside_limits(q + way * (spread / np.abs(way).max()), np.inf)
            if model.valid(goal, snapshot, at=q) and touch.eases(np.stack([q, goal]), 1e-6):
                return goal
    return None


def leaves(
    model: CollisionModel,
    path: JointPath,
    snapshot: WorkspaceSnapshot,
    at: JointVector,
    rubs: float = SLACK,
) -> bool:
    """Whether a body that touches something at (n,) [rad] may move along a (k, n) path.

    On it no sphere that touches comes nearer to what it touches than it is at ``at``, no other
    sphere begins to touch, and the same holds for the body against itself. Looked at in steps of
    2 mm, not proven: it is short, and it leads away. False where nothing touches, or too deep:
    then a proof decides. What hangs from the last link may touch deeper by ``rubs`` [m].
    """
    touch = _Touch(model, at, snapshot)
    link = model.body.link
    slack = np.where(link == link.max(initial=0), rubs, SLACK)
    return 0.0 < touch.depth <= DEPTH and touch.eases(path, slack)


class _Touch:
    """What a body touches where it stands, and whether a motion makes that worse."""

    def __init__(self, model: CollisionModel, q: JointVector, snapshot: WorkspaceSnapshot) -> None:
        self._model = model
        self._obstacles = model.obstacles(snapshot, q)
        self._now = np.empty(len(model.body.radius))
        floor = model.config.floor
        self._own = min(self._look(q), floor)
        self._allowed = np.minimum(self._now.copy(), floor)
        self.depth = floor - min(self._own, float(self._allowed.min(initial=floor)))

    def eases(self, path: JointPath, slack: Floats | float) -> bool:
        """Whether no sphere touches more along a (k, n) path than where the body stands.

        Less than ``slack`` [m], one for all spheres or (m,), is no more.
        """
        reach = self._model.body.lever.sum(axis=1).max(initial=0.1)
        for a, b in pairwise(path):
            steps = int(np.ceil(reach * np.abs(b - a).max() / STEP))
            for s in np.linspace(0.0, 1.0, steps + 1)[1:]:
                own = self._look(a + s * (b - a))
                if own < self._own - SLACK or (self._now < self._allowed - slack).any():
                    return False
        return True

    def _look(self, q: JointVector) -> float:
        """Fill in the spheres' clearances at (n,) [rad]; returns the body's from itself [m]."""
        body, scratch = self._model.body, self._model.scratch()
        body_centers(body, q, scratch.centers)
        sphere_clearances(self._obstacles, scratch.centers, body.radius, self._now)
        sink(self._obstacles, scratch.centers, 2.0 * DEPTH, self._now)
        return float(self_clearance(body, scratch.centers))
