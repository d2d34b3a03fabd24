"""Bodies of the UR10e and UR16e, which no package has meshes of: convex hulls of round outlines.

The outlines were measured on the collision meshes of the maker's ur_description (which are convex
themselves) and lie around them: no point of those is farther outside than 0.4 mm, and the hulls
stand out from them by 2 mm in the middle and by 10 mm at most on 95 % of their surface. The two
arms have every part in common but the lengths of their tubes.
"""

from __future__ import annotations

import math

import numpy as np
import trimesh
from robot_sources.parts import Part

Outline = tuple[int, tuple[float, float, float], tuple[tuple[float, float], ...]]
"""An axis (0 x, 1 y, 2 z), a point on it, and (place along the axis, radius) pairs, all [m]."""
SIDES = 48
GREY = (0.82, 0.82, 0.82)
ORIGIN = (0.0, 0.0, 0.0)

BASE: tuple[Outline, ...] = ((2, ORIGIN, ((0.0, 0.096), (0.0215, 0.0955), (0.0998, 0.077))),)
SHOULDER: tuple[Outline, ...] = (
    (2, ORIGIN, ((-0.0825, 0.0745), (-0.075, 0.0775), (0.056, 0.078), (0.0805, 0.0745))),
    (2, (0.0, 0.016, 0.0), ((0.0885, 0.068), (0.0945, 0.0565))),
    (1, ORIGIN, ((0.06, 0.0885), (0.078, 0.089), (0.0885, 0.084), (0.0955, 0.0775))),
)
WRIST_1: tuple[Outline, ...] = (
    (
        2,
        (0.0, 0.135, 0.0),
        ((-0.058, 0.036), (-0.0545, 0.042), (-0.046, 0.0465), (-0.0125, 0.0485), (0.0672, 0.048)),
    ),
    (1, ORIGIN, ((0.0665, 0.052), (0.07, 0.054))),
)
WRIST_2: tuple[Outline, ...] = (
    (
        1,
        (0.0, 0.0, 0.12),
        ((-0.058, 0.036), (-0.0545, 0.042), (-0.046, 0.0465), (-0.0125, 0.0485), (0.0685, 0.048)),
    ),
    (2, ORIGIN, ((0.0665, 0.054), (0.07, 0.0555))),
)
WRIST_3: tuple[Outline, ...] = (
    (
        1,
        ORIGIN,
        (
            (0.0675, 0.0485),
            (0.0755, 0.0525),
            (0.0865, 0.0525),
            (0.1085, 0.0475),
            (0.1135, 0.046),
            (0.117, 0.0395),
        ),
    ),
)


def upper_arm(length: float) -> tuple[Outline, ...]:
    """Between the shoulder's axis and the elbow's, this far apart [m]."""
    return (
        (
            1,
            ORIGIN,
            (
                (-0.0825, 0.0745),
                (-0.075, 0.0775),
                (0.056, 0.078),
                (0.078, 0.0745),
                (0.0875, 0.0705),
                (0.094, 0.05),
            ),
        ),
        (
            1,
            (0.0, 0.0, length),
            (
                (-0.0793, 0.0595),
                (-0.07, 0.061),
                (0.0365, 0.0615),
                (0.058, 0.0585),
                (0.067, 0.05),
                (0.073, 0.036),
            ),
        ),
    )


def forearm(length: float) -> tuple[Outline, ...]:
    """Between the elbow's axis and the first wrist's, this far apart [m]."""
    return (
        (
            1,
            ORIGIN,
            (
                (-0.0365, 0.0115),
                (-0.029, 0.029),
                (-0.0185, 0.042),
                (-0.0055, 0.0505),
                (0.0155, 0.0575),
                (0.059, 0.061),
                (0.062, 0.059),
            ),
        ),
        (2, ORIGIN, ((-0.012, 0.053), (0.02, 0.0585), (0.06, 0.059))),
        (
            1,
            (0.0, 0.0, length),
            (
                (-0.0585, 0.036),
                (-0.0545, 0.042),
                (-0.048, 0.046),
                (-0.031, 0.0485),
                (0.0672, 0.048),
            ),
        ),
    )


def bodies(upper: float, fore: float) -> list[Part]:
    """Base, shoulder, upper arm, forearm, wrists 1 to 3, in the frames of the maker's meshes."""
    rows = (BASE, SHOULDER, upper_arm(upper), forearm(fore), WRIST_1, WRIST_2, WRIST_3)
    return [hull(outlines) for outlines in rows]


def hull(outlines: tuple[Outline, ...]) -> Part:
    """The convex hull of the circles of some outlines, each circle inside its polygon."""
    angle = np.linspace(0.0, 2.0 * math.pi, SIDES, endpoint=False)
    points = []
    for axis, center, profile in outlines:
        across = [k for k in range(3) if k != axis]
        for place, radius in profile:
            ring = np.zeros((SIDES, 3))
            ring[:, axis] = place
            ring[:, across[0]] = radius / math.cos(math.pi / SIDES) * np.cos(angle)
            ring[:, across[1]] = radius / math.cos(math.pi / SIDES) * np.sin(angle)
            points.append(ring + np.asarray(center))
    solid = trimesh.convex.convex_hull(np.concatenate(points))
    return Part(GREY, np.asarray(solid.vertices), np.asarray(solid.faces))
