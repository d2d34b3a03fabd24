"""Joint positions of a sample: anywhere that the arm touches neither itself nor what it stands on.

Uniform over the joint ranges, with more stretched (near-singular) arms than chance would give.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import JointVector, Points, Pose, Poses
from armsight.recognition.data.arms import Arm
from armsight.recognition.data.things import Thing, box_gap

STRETCHED = 0.15
"""Share of configurations with one bending joint near zero."""
GAP = 0.01
"""Least distance from what the arm stands on [m]."""
TRIES = 400


def draw_configuration(
    arm: Arm, T_world_base: Pose, blocked: Sequence[Thing], rng: np.random.Generator
) -> JointVector | None:
    """(n,) joint positions [rad] without contact, or None if none was found.

    Args:
        arm: the arm.
        T_world_base: where it stands; the floor is z = 0.
        blocked: boxes that it must not touch.
        rng: source of randomness.
    """
    for _ in range(TRIES):
        q = rng.uniform(arm.lower, arm.upper)
        if rng.random() < STRETCHED:
            bend = int(rng.integers(1, min(4, arm.n)))
            q[bend] = np.clip(rng.normal(0.0, 0.12), arm.lower[bend], arm.upper[bend])
        poses = T_world_base @ arm.link_poses(q)
        if is_free(arm, poses, blocked):
            return np.asarray(q)
    return None


def is_free(arm: Arm, T_world_link: Poses, blocked: Sequence[Thing]) -> bool:
    """Whether the arm touches neither itself, nor the floor, nor a blocked box."""
    centers = arm.spheres(T_world_link)
    # The base and the first link touch the mount by design.
    moving = arm.sphere_link >= 2
    free, radius = centers[moving], arm.sphere_radius[moving]
    if np.any(free[:, 2] - radius < GAP):
        return False
    if any(np.any(box_gap(free, box) < radius + GAP) for box in blocked):
        return False
    return not _touches_itself(arm, centers)


def _touches_itself(arm: Arm, centers: Points) -> bool:
    members = [np.flatnonzero(arm.sphere_link == i) for i in range(arm.n + 1)]
    for a, b in arm.pairs:
        i, j = members[a], members[b]
        gap = np.linalg.norm(centers[i][:, None] - centers[j][None], axis=2)
        if np.any(gap < arm.sphere_radius[i][:, None] + arm.sphere_radius[j][None]):
            return True
    return False
