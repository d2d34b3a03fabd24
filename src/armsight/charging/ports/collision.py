"""What a socket and a plug are to contact physics: boxes and capsules, from the table of measures.

A cavity is a ring of boxes whose inner faces lie on its outline, a sleeve is a ring of capsules
just inside its own. Convex hulls of meshes would close the hole; N flat boxes leave corners of
R (1 / cos(pi / N) - 1), 0.08 mm at 48 around a Type 2 sleeve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.ports.outline import Outline, sample_union
from armsight.charging.ports.table import MM, Port
from armsight.geometry.pose import make_pose, transform

AROUND = 48
"""Boxes and capsules around a round sleeve."""
ROUND = 1.5 * MM
"""Radius of the sleeve's front edge [m]."""
WALL = 4 * MM
REACH = np.linspace(-1.0, 1.0, 5)


@dataclass(frozen=True)
class Contours:
    """Collision shapes in a port's frame.

    Attributes:
        boxes: (n, 4, 4) poses; half: (n, 3) half edges [m].
        capsules: (m, 6) ends [m]; radius: of each [m].
    """

    boxes: Floats
    half: Floats
    capsules: Floats
    radius: float


def sleeves(plug: Port) -> list[Outline]:
    """Outlines of what enters the inlet."""
    bores = [rim.outline for rim in plug.of_kind("mouth")]
    return [plug.plate, *(bore.grown(4 * MM) for bore in bores[1:])]


def plug_contours(plug: Port) -> Contours:
    """Capsules along a plug's sleeve; its frame looks out of its mouth, the sleeve lies behind."""
    p, _ = sample_union([s.grown(-ROUND) for s in sleeves(plug)], _step(plug))
    n = len(p)
    front, back = np.full(n, -ROUND), np.full(n, -plug.depth + ROUND)
    ends = np.column_stack([p, front, p, back])
    return Contours(np.zeros((0, 4, 4)), np.zeros((0, 3)), ends, ROUND)


def socket_contours(plug: Port, clearance: float, chamfer: float, depth: float) -> Contours:
    """Boxes about the cavity into which a plug fits, with its chamfer and its seat.

    Args:
        plug: that enters.
        clearance: between sleeve and wall [m].
        chamfer: of the mouth, at 45 deg [m].
        depth: at which the plug is seated [m].

    Returns:
        Shapes in the socket's frame: its mouth at z = 0, z towards who looks.
    """
    outlines = [s.grown(clearance) for s in sleeves(plug)]
    p, n = sample_union(outlines, _step(plug))
    half = 0.5 * _step(plug)
    wide = 2.5 * WALL
    boxes: list[tuple[Pose, list[float]]] = []
    for (x, y), (a, b) in zip(p, n):
        across, along = np.array([a, b, 0.0]), np.array([-b, a, 0.0])
        wall = np.column_stack([across, along, [0.0, 0.0, 1.0]])
        middle = np.array([x, y, 0.0])
        deep = 0.5 * (depth + 2 * WALL - chamfer)
        at = middle + WALL * across - [0, 0, chamfer + deep]
        boxes.append((_pose(wall, at), [WALL, half, deep]))
        # the chamfer's face runs from (outline, -chamfer) outwards to (outline + chamfer, 0)
        out = np.array([a, b, 1.0]) / np.sqrt(2.0)
        up = np.array([-a, -b, 1.0]) / np.sqrt(2.0)
        slope = np.column_stack([out, along, np.cross(out, along)])
        face = middle + 0.5 * chamfer * across - [0, 0, 0.5 * chamfer]
        width = half * (1.0 + 0.5 * chamfer / plug.plate.radius)
        boxes.append((_pose(slope, face - WALL * up), [chamfer / np.sqrt(2.0), width, WALL]))
        # the face about the mouth, on which a plug slides that misses it
        flat = middle + (chamfer + wide) * across - [0, 0, WALL]
        boxes.append((_pose(wall, flat), [wide, 2.0 * half, WALL]))
    # where two sleeves meet, a box of one would stand in the other one's way
    boxes = [(T, size) for T, size in boxes if not _in_the_way(T, size, outlines, chamfer)]
    low, high = p.min(axis=0) - WALL, p.max(axis=0) + WALL
    seat = np.append(0.5 * (low + high), -depth - WALL)
    boxes.append((_pose(np.eye(3), seat), [*(0.5 * (high - low)), WALL]))
    return Contours(
        np.array([T for T, _ in boxes]),
        np.array([size for _, size in boxes]),
        np.zeros((0, 6)),
        0.0,
    )


def _in_the_way(T: Pose, size: list[float], outlines: Sequence[Outline], chamfer: float) -> bool:
    """Whether a box reaches into the cavity, which is wider above its chamfer."""
    grid = np.stack(np.meshgrid(REACH, REACH, REACH), -1).reshape(-1, 3) * np.asarray(size)
    points = transform(T, grid)
    points = points[points[:, 2] < -1e-5]
    lead = np.maximum(chamfer + points[:, 2], 0.0)
    for outline in outlines:
        # a point is inside an outline grown by its lead where the outline holds it so far out
        for step in np.linspace(0.0, chamfer, 5):
            mine = lead >= step
            if outline.grown(step).contains(points[mine], 1.5e-4).any():
                return True
    return False


def _step(plug: Port) -> float:
    return float(2 * np.pi * plug.plate.radius / AROUND)


def _pose(R: Floats, p: Floats) -> Pose:
    if np.linalg.det(R) < 0:
        R = R * np.array([1.0, 1.0, -1.0])
    return make_pose(R, p)
