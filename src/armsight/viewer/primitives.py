"""Unit shapes for instancing: edges and diameters of 1 about the origin, faces outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from armsight.arrays import Floats32


@dataclass(frozen=True)
class Shape:
    """A surface of triangles.

    Attributes:
        vertices: (n, 3) float32 [m].
        faces: (m, 3) uint32 corners.
    """

    vertices: Floats32
    faces: NDArray[np.uint32]


def _shape(mesh: Any) -> Shape:
    return Shape(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32))


CUBE = _shape(trimesh.creation.box(extents=(1.0, 1.0, 1.0)))
SPHERE = _shape(trimesh.creation.icosphere(subdivisions=3, radius=0.5))
# Its rims are split, so that the round stays smooth and the ends flat.
CYLINDER = _shape(
    trimesh.graph.smooth_shade(
        trimesh.creation.cylinder(radius=0.5, height=1.0, sections=32), angle=np.deg2rad(40.0)
    )
)
