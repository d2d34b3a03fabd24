"""What a mesh encloses: points spread on its surface and voxels of its inside.

Robots' meshes are rarely closed: they come in shells, one a colour, with open ends where the next
link begins. The inside is therefore what a flood from the outside cannot reach, after flat open
ends have been capped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from armsight.arrays import Floats, Ints, Points
from armsight.robots.fit_kernels import triangle_lattices
from armsight.robots.meshes import Triangles


def sample_surface(triangles: Triangles, spacing: float) -> Points:
    """(n, 3) points on triangles such that none of the surface is farther than ``spacing`` [m].

    A lattice on every triangle, its corners included; no randomness.
    """
    vertices, faces = triangles
    return np.asarray(triangle_lattices(np.ascontiguousarray(vertices[faces]), spacing))


def thin(points: Points, spacing: float) -> Points:
    """The points, at most one a cell of a grid of this spacing [m]."""
    if not len(points):
        return points
    cell = np.floor(points / spacing).astype(np.int64)
    cell -= cell.min(axis=0)
    # One number a cell: numpy sorts rows ten times as long.
    number = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
    _, first = np.unique(number, return_index=True)
    return np.asarray(points[np.sort(first)])


@dataclass(frozen=True)
class VoxelSolid:
    """The inside of a body as voxels.

    Attributes:
        origin: (3,) lower corner of voxel (0, 0, 0) [m].
        voxel: edge [m].
        inside: (nx, ny, nz) true where the body is: surface or enclosed.
        outside: (nx, ny, nz) true where a flood from outside comes; capped ends block it.
    """

    origin: Floats
    voxel: float
    inside: NDArray[np.bool_]
    outside: NDArray[np.bool_]

    def contains(self, points: Points) -> NDArray[np.bool_]:
        """(n,) whether points lie in a voxel of the body."""
        index = np.floor((points - self.origin) / self.voxel).astype(np.int64)
        within = ((index >= 0) & (index < self.inside.shape)).all(axis=1)
        result = np.zeros(len(points), bool)
        result[within] = self.inside[tuple(index[within].T)]
        return result

    def centers(self, mask: NDArray[np.bool_]) -> Points:
        """(n, 3) centres of the voxels that a mask of the grid's shape selects."""
        return np.asarray((np.argwhere(mask) + 0.5) * self.voxel + self.origin)


def voxelise(triangles: Triangles, voxel: float) -> VoxelSolid:
    """The voxels of a body, open ends capped."""
    vertices, faces = triangles
    surface = sample_surface(triangles, 0.5 * voxel)
    caps = _caps(vertices, faces, 0.5 * voxel)
    points = np.concatenate([surface, caps])
    origin = points.min(axis=0) - 3 * voxel
    shape = tuple(np.ceil((points.max(axis=0) - origin) / voxel).astype(int) + 3)
    wall = np.zeros(shape, bool)
    wall[tuple(np.floor((points - origin) / voxel).astype(np.int64).T)] = True
    skin = np.zeros(shape, bool)
    skin[tuple(np.floor((surface - origin) / voxel).astype(np.int64).T)] = True
    label, _ = ndimage.label(~wall)
    outside = label == label[0, 0, 0]
    return VoxelSolid(origin, voxel, ~outside & (~wall | skin | _enclosed(outside)), outside)


def _enclosed(outside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Voxels that do not touch the outside: parts of caps in the depth count as inside."""
    return ~ndimage.binary_dilation(outside)


def outer_surface(surface: Points, solid: VoxelSolid) -> Points:
    """The points of a surface that face the outside."""
    reach = ndimage.binary_dilation(solid.outside, np.ones((3, 3, 3), bool))
    index = np.floor((surface - solid.origin) / solid.voxel).astype(np.int64)
    return np.asarray(surface[reach[tuple(index.T)]])


def _caps(vertices: Points, faces: Ints, spacing: float) -> Points:
    """Points on flat lids over the open ends of a mesh."""
    tree = cKDTree(vertices)
    merged = np.arange(len(vertices))
    for a, b in tree.query_pairs(2e-5):
        merged[max(a, b)] = min(merged[a], merged[b], merged[max(a, b)])
    faces = merged[faces]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    unique, count = np.unique(edges, axis=0, return_counts=True)
    lids = []
    for loop in _loops(unique[count == 1]):
        ring = vertices[loop]
        center = ring.mean(axis=0)
        normal = np.linalg.svd(ring - center, full_matrices=False)[2][2]
        if len(loop) < 3 or np.abs((ring - center) @ normal).max() > 0.004:
            continue
        fan = np.stack([np.broadcast_to(center, ring.shape), ring, np.roll(ring, -1, 0)], 1)
        corners = fan.reshape(-1, 3)
        lids.append(sample_surface((corners, np.arange(len(corners)).reshape(-1, 3)), spacing))
    return np.concatenate(lids) if lids else np.empty((0, 3))


def _loops(edges: Ints) -> list[Ints]:
    """Closed rings of open edges, each as vertex indices in order."""
    following: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        following.setdefault(a, []).append(b)
        following.setdefault(b, []).append(a)
    loops = []
    seen: set[int] = set()
    for start in following:
        if start in seen:
            continue
        ring = [start]
        seen.add(start)
        while True:
            after = [v for v in following[ring[-1]] if v not in seen]
            if not after:
                break
            ring.append(after[0])
            seen.add(after[0])
        if len(ring) >= 3 and start in following[ring[-1]]:
            loops.append(np.array(ring))
    return loops
