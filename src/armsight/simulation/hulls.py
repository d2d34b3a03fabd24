"""Convex pieces of a link's mesh: contacts are computed between convex bodies only.

The hull of a whole link fills its elbows; the hulls of slices along its longest axis follow it.
Together the pieces contain the mesh.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from armsight.arrays import Ints, Points
from armsight.robots.meshes import read_mesh_file


def convex_pieces(vertices: Points, faces: Ints, slices: int = 5) -> list[Points]:
    """Vertices of the hulls of a mesh's slices along its longest axis.

    Args:
        vertices: (v, 3) [m].
        faces: (f, 3) vertex indices.
        slices: pieces to cut into.

    Returns:
        One (k, 3) array of hull vertices a piece [m]; at least one.
    """
    return list(
        _pieces(
            np.asarray(vertices, float).tobytes(), np.asarray(faces, np.int64).tobytes(), slices
        )
    )


@lru_cache(maxsize=256)
def _pieces(vertex_data: bytes, face_data: bytes, slices: int) -> tuple[Points, ...]:
    """The same from (v, 3) float64 and (f, 3) int64: every world with this body asks."""
    vertices = np.frombuffer(vertex_data).reshape(-1, 3)
    faces = np.frombuffer(face_data, np.int64).reshape(-1, 3)
    if slices < 2:
        whole = hull_vertices(vertices)
        return (vertices if whole is None else whole,)
    axis = int(np.argmax(np.ptp(vertices, axis=0)))
    lower, upper = vertices[:, axis].min(), vertices[:, axis].max()
    cuts = np.linspace(lower, upper, slices + 1)
    edges = np.unique(
        np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1),
        axis=0,
    )
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    borders = [_crossings(a, b, axis, cut) for cut in cuts]
    pieces = []
    for i in range(slices):
        inside = (vertices[:, axis] >= cuts[i]) & (vertices[:, axis] <= cuts[i + 1])
        points = np.concatenate([vertices[inside], borders[i], borders[i + 1]])
        hull = hull_vertices(points)
        if hull is not None:
            pieces.append(hull)
    return tuple(pieces) or (vertices,)


def hull_vertices(points: Points) -> Points | None:
    """(k, 3) corners of the convex hull, or None where the points have no volume."""
    if len(points) < 4:
        return None
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    if hull.volume < 1e-8:
        return None
    return np.asarray(points[hull.vertices])


@lru_cache(maxsize=64)
def load_mesh(path: Path) -> trimesh.Trimesh:
    """A link's surface; read once."""
    return trimesh.Trimesh(*read_mesh_file(path), process=False)


def _crossings(a: Points, b: Points, axis: int, cut: float) -> Points:
    """(k, 3) points where the edges a-b cross the plane ``axis = cut``."""
    da, db = a[:, axis] - cut, b[:, axis] - cut
    across = da * db < 0
    w = (da[across] / (da[across] - db[across]))[:, None]
    return np.asarray((1 - w) * a[across] + w * b[across])
