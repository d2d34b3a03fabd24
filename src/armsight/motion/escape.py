"""The way out of a start that touches something by a little: noise, or something came too near."""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
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


def escape(
    model: CollisionModel, q: JointVector, snapshot: WorkspaceSnapshot, rng: np.random.Generator
) -> JointVector | None:
    """A free configuration near q that is reached without touching anything more; or None.

    On the straight way there no sphere that touches comes nearer to what it touches than it is, no
    other sphere begins to touch, and the same holds for the body against itself. Looked at in
    steps of 2 mm, not proven: it is short, and it leads away.
    """
    if not model.within_limits(q):
        return None
    ob = model.obstacles(snapshot, q)
    body, floor = model.body, model.config.floor
    scratch = model.scratch()
    now = np.empty(len(body.radius))

    def look(at: JointVector) -> float:
        """Fill ``now`` with clearances at a place; returns the body's clearance from itself."""
        body_centers(body, at, scratch.centers)
        sphere_clearances(ob, scratch.centers, body.radius, now)
        return float(self_clearance(body, scratch.centers))

    own = min(look(q), floor)
    allowed = np.minimum(now.copy(), floor)
    if min(own, allowed.min(initial=floor)) < -DEPTH:
        return None
    reach = body.lever.sum(axis=1).max(initial=0.1)
    for spread in SPREADS:
        for _ in range(TRIES):
            way = rng.normal(size=len(q))
            goal = model.inside_limits(q + way * (spread / np.abs(way).max()), np.inf)
            if not model.valid(goal, snapshot, at=q):
                continue
            steps = int(np.ceil(reach * np.abs(goal - q).max() / STEP))
            for s in np.linspace(0.0, 1.0, steps + 1)[1:]:
                if look(q + s * (goal - q)) < own - 1e-6 or (now < allowed - 1e-6).any():
                    break
            else:
                return goal
    return None
