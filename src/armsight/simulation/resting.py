"""Where a thing can stand: on what, at which height, and as near to a wish as can be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Points, Vector3
from armsight.geometry.shapes import Solid

CONTACT = 0.001
"""Nearer than this is touching [m]."""
FALLS = 60
"""Steps of a fall; who has not landed then falls along a wall."""
LIFT = 0.05
"""Out of what it is inside of, a point is lifted in such steps [m]."""
LEVEL = 0.005
"""What a foot stands on differs in height by no more [m]."""
GRID, AROUND = 0.04, 1.2
"""Places are tried this far from each other, and up to this far away [m]."""


def landing(points: Points, solids: Sequence[Solid]) -> Floats:
    """(k,) height [m] at which (k, 3) points that fall come to lie: on a solid, or on the floor.

    A point inside a solid falls from above it. NaN for one that touches a wall on its way.
    """
    at = np.array(points, float)

    def free() -> Floats:
        away = [solid.distance(at) for solid in solids]
        return np.minimum(np.min(away, axis=0), at[:, 2]) if away else at[:, 2].copy()

    for _ in range(FALLS):
        inside = free() < 0.0
        if not inside.any():
            break
        at[inside, 2] += LIFT
    for _ in range(FALLS):
        room = free()
        if (room < CONTACT).all():
            break
        at[:, 2] -= np.where(room < CONTACT, 0.0, room)
    landed = free() < CONTACT
    below = at - np.array([0.0, 0.0, 2.0 * CONTACT])
    held = np.any([solid.distance(below) < 0.0 for solid in solids] or [landed & False], axis=0)
    return np.where(landed & (held | (at[:, 2] < CONTACT)), at[:, 2], np.nan)


def places(wish: Vector3, half: Vector3, solids: Sequence[Solid]) -> Points:
    """(k, 3) centres where a thing can stand with its whole foot, nearest to a wish first [m].

    Args:
        wish: (3,) where its centre should be [m]; it stands on what is below.
        half: (3,) half its extent along the axes [m].
        solids: that stand there.
    """
    steps = np.arange(-AROUND, AROUND + 0.5 * GRID, GRID)
    offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offset = offset[np.argsort(np.hypot(*offset.T), kind="stable")]
    foot = np.array([(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]) * half[:2]
    feet = np.empty((len(offset), len(foot), 3))
    feet[..., :2] = wish[:2] + offset[:, None] + foot
    feet[..., 2] = max(wish[2] - half[2], CONTACT)
    heights = landing(feet.reshape(-1, 3), solids).reshape(feet.shape[:2])
    level = np.ptp(heights, axis=1) < LEVEL  # NaN is not
    centre = np.column_stack([wish[:2] + offset, heights.max(axis=1) + half[2]])
    return centre[level]
