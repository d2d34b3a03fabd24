"""Declared solids: what a workcell file places and what planner, map and simulator share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armsight.arrays import Floats, Floats32, Ints, Points, Pose, Vector3
from armsight.geometry.pose import inverse, transform

ShapeKind = Literal["box", "cylinder", "sphere"]


@dataclass(frozen=True)
class Solid:
    """A box, cylinder (along its z) or sphere at a pose.

    Attributes:
        name: unique in its cell.
        kind: box, cylinder or sphere.
        size: box: full edges (x, y, z); cylinder: (radius, full height, 0);
            sphere: (radius, 0, 0) [m].
        T_frame_solid: its centre's pose in the frame that the owner states.
        color: RGB, 0..1.
        material: ``plain``, ``black_plastic`` (no infrared return) or ``shiny``.
        coarse: what stands there may be smaller: its surface may lie this deep inside [m].
    """

    name: str
    kind: ShapeKind
    size: tuple[float, float, float]
    T_frame_solid: Pose
    color: tuple[float, float, float] = (0.7, 0.7, 0.7)
    material: str = "plain"
    coarse: float = 0.0

    @property
    def half_edges(self) -> Vector3:
        """(3,) half the edges of the box around it, in its own frame [m]."""
        a, b, c = self.size
        if self.kind == "box":
            return 0.5 * np.array([a, b, c])
        return np.array([a, a, 0.5 * b if self.kind == "cylinder" else a])

    @property
    def half_extent(self) -> Vector3:
        """(3,) half the edges of the box along its owner's axes around it [m]."""
        return np.asarray(np.abs(self.T_frame_solid[:3, :3]) @ self.half_edges)

    def distance(self, points: Points) -> Floats:
        """(n,) signed distance [m] of (n, 3) points in the owner's frame; negative inside."""
        p = transform(inverse(self.T_frame_solid), np.asarray(points, float))
        if self.kind == "sphere":
            return np.asarray(np.linalg.norm(p, axis=1) - self.size[0])
        if self.kind == "box":
            q = np.abs(p) - 0.5 * np.asarray(self.size)
        else:
            radial = np.linalg.norm(p[:, :2], axis=1) - self.size[0]
            q = np.stack([radial, np.abs(p[:, 2]) - 0.5 * self.size[1]], axis=1)
        outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
        return np.asarray(outside + np.minimum(q.max(axis=1), 0.0))


@dataclass(frozen=True)
class Surface:
    """A coloured surface of triangles, for drawing only.

    Attributes:
        name: unique in what it belongs to.
        vertices: (n, 3) float32 in the owner's frame [m].
        faces: (m, 3) corners, outward.
        color: RGB, 0..1.
    """

    name: str
    vertices: Floats32
    faces: Ints
    color: tuple[float, float, float]
