"""Declared solids on the grid: which voxels they fill, and which hits they explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats, Ints, Points, Poses
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import VoxelGrid

KINDS = {"box": 0, "cylinder": 1, "sphere": 2}


@dataclass(frozen=True)
class StaticGeometry:
    """Declared solids, for compiled loops.

    Attributes:
        grid: the grid.
        filled: (nx, ny, nz) uint8, 1 where a voxel and a solid overlap.
        nearest: (nx, ny, nz) uint8, 1 + index of the closest solid, 0 where none is near.
        bound: (nx, ny, nz) int8, signed distance from the voxel's centre to that solid [mm].
        kinds: (m,) 0 box, 1 cylinder, 2 sphere; sizes: (m, 3) as in :class:`Solid` [m].
        T_solid_base: (m, 4, 4).
        coarse: (m,) how deep inside of its shape a solid's surface may lie [m].
        solids: the same as declared, in ``base``.
    """

    grid: VoxelGrid
    filled: Bytes
    nearest: Bytes
    bound: NDArray[np.int8]
    kinds: Ints
    sizes: Floats
    T_solid_base: Poses
    coarse: Floats
    solids: tuple[Solid, ...]

    @property
    def table(self) -> tuple[Ints, Floats, Poses, Floats]:
        """For compiled loops that explain returns: kinds, sizes, poses, coarse."""
        return self.kinds, self.sizes, self.T_solid_base, self.coarse


def rasterise(solids: Sequence[Solid], grid: VoxelGrid, near: float) -> StaticGeometry:
    """Put solids (in ``base``) on a grid.

    Args:
        solids: at most 255.
        grid: the grid.
        near: ``nearest`` names a solid wherever a point of the voxel may be this close [m]; at
            most 12 cm less half the voxel's diagonal, so that ``bound`` can hold it.

    Raises:
        ValueError: there are more than 255 solids.
    """
    if len(solids) > 255:
        raise ValueError(f"{len(solids)} declared solids; the map can tell 255 apart")
    filled = np.zeros(grid.shape, np.uint8)
    nearest = np.zeros(grid.shape, np.uint8)
    closest = np.full(grid.shape, 1.0, np.float32)
    diagonal = 0.5 * np.sqrt(3.0) * grid.voxel
    for number, solid in enumerate(solids, 1):
        block = _block(solid, grid, near + diagonal)
        if block is None:
            continue
        index = np.stack(np.meshgrid(*(np.arange(s.start, s.stop) for s in block), indexing="ij"))
        centers = grid.center(index.reshape(3, -1).T)
        distance = solid.distance(centers).reshape(index.shape[1:])
        nearer = (distance < closest[block]) & (distance <= near + diagonal)
        nearest[block][nearer] = number
        closest[block][nearer] = distance[nearer]
        maybe = distance.reshape(-1) <= diagonal
        overlap = np.zeros(maybe.shape, bool)
        overlap[maybe] = overlaps(solid, centers[maybe], grid.voxel)
        filled[block] |= overlap.reshape(distance.shape).astype(np.uint8)
    return StaticGeometry(
        grid,
        filled,
        nearest,
        np.clip(np.round(1e3 * closest), -127, 127).astype(np.int8),
        np.array([KINDS[s.kind] for s in solids], np.int64),
        np.array([s.size for s in solids], float).reshape(-1, 3),
        np.array([inverse(s.T_frame_solid) for s in solids], float).reshape(-1, 4, 4),
        np.array([s.coarse for s in solids], float),
        tuple(solids),
    )


def _block(solid: Solid, grid: VoxelGrid, pad: float) -> tuple[slice, slice, slice] | None:
    half = solid.half_extent + pad
    center = solid.T_frame_solid[:3, 3]
    low = np.maximum(grid.index((center - half)[None])[0], 0)
    high = np.minimum(grid.index((center + half)[None])[0] + 1, grid.shape)
    if (low >= high).any():
        return None
    return (slice(low[0], high[0]), slice(low[1], high[1]), slice(low[2], high[2]))


def overlaps(solid: Solid, centers: Points, voxel: float) -> np.ndarray:
    """(n,) whether axis-aligned cubes about (n, 3) centres overlap a solid by more than a touch.

    Exact for boxes and spheres; cylinders may claim cubes that they miss by up to an eighth of a
    voxel.
    """
    h = 0.5 * voxel - 1e-6
    d = np.asarray(centers, float) - solid.T_frame_solid[:3, 3]
    if solid.kind == "sphere":
        gap = np.maximum(np.abs(d) - h, 0.0)
        return np.asarray((gap**2).sum(axis=1) < solid.size[0] ** 2)
    R = solid.T_frame_solid[:3, :3]
    if solid.kind == "box":
        return _box_overlaps(d, R, 0.5 * np.asarray(solid.size, float), h)
    steps = (np.arange(4) - 1.5) * (2 * h / 4)
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    found = np.zeros(len(d), bool)
    for offset in offsets:
        found |= solid.distance(np.asarray(centers, float) + offset) < 0.25 * h * 0.9
    return found


def _box_overlaps(d: Points, R: Floats, half: Floats, h: float) -> np.ndarray:
    """Separating axes between cubes of half edge ``h`` at offsets ``d`` and one turned box."""
    axes = [np.eye(3)[i] for i in range(3)] + [R[:, i] for i in range(3)]
    for i in range(3):
        for j in range(3):
            axis = np.cross(np.eye(3)[i], R[:, j])
            if np.linalg.norm(axis) > 1e-9:
                axes.append(axis / np.linalg.norm(axis))
    apart = np.zeros(len(d), bool)
    for axis in axes:
        reach = h * np.abs(axis).sum() + float(half @ np.abs(R.T @ axis))
        apart |= np.abs(d @ axis) >= reach
    return ~apart
