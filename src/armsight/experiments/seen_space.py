"""What perfect depth pictures tell of space: a grid of voxels, and points finer than its voxels.

A cube is *free* if some picture saw through all of it, *hidden* if no picture saw any of it. Where
that is asked for, a voxel that is neither is divided, down to an eighth of its edge. Of those small
cubes one counts as seen if some picture looked into all of it: what is not seen of it lies behind a
surface within it, and that surface is a point. Small cubes that are hidden become points as well,
so that in the end a voxel is free but for its points, or unknown altogether.

Between two points something may protrude: half a small cube's diagonal, and what lies between
neighbouring pixels. Who uses this adds a margin of that size to the body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats32, Mask, Pose
from armsight.experiments.seen_space_kernels import classify, mark, thinned
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.motion.detail import DetailedSnapshot, make_detail

LATTICE = 0.002
"""Of points in the same cube of this edge [m] one is kept."""
CAP = 15
"""Reach of the distance field [voxels]."""


@dataclass(frozen=True)
class Seen:
    """What pictures tell of a grid.

    Attributes:
        grid: the voxels.
        state: (nx, ny, nz) FREE but for points; UNKNOWN; OCCUPIED where a voxel that was not
            looked at in detail holds a surface.
        surface: (k, 3) points of surfaces in the voxels looked at in detail, in ``base`` [m].
        hidden: (l, 3) middles of small cubes there that no picture saw [m].
    """

    grid: VoxelGrid
    state: Bytes
    surface: Floats32
    hidden: Floats32


def space_seen(
    grid: VoxelGrid,
    lens: PinholeCamera,
    poses: Sequence[Pose],
    images: Sequence[DepthImage],
    divided: Mask,
) -> Seen:
    """What pictures tell of a grid; (nx, ny, nz) ``divided`` says where in detail."""
    levels = [_pyramid(np.where(np.isnan(i), np.float32(np.inf), i)) for i in images]
    sizes = np.array([[*low.shape] for low, _ in levels[0]], np.int64)
    begins = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))]).astype(np.int64)
    low = np.stack([np.concatenate([a.ravel() for a, _ in one]) for one in levels])
    high = np.stack([np.concatenate([b.ravel() for _, b in one]) for one in levels])
    views = np.array([inverse(T) for T in poses])
    K = np.array([lens.fx, lens.fy, lens.cx, lens.cy])
    state = np.full(grid.shape, UNKNOWN, np.uint8)
    origin = np.asarray(grid.origin, float)
    hidden = classify(state, divided, origin, grid.voxel, views, K, low, high, sizes, begins)
    index = np.argwhere(divided) if divided.any() else np.zeros((1, 3), np.int64)
    bottom = grid.origin + index.min(axis=0) * grid.voxel
    cells = np.ceil((index.max(axis=0) + 1 - index.min(axis=0)) * grid.voxel / LATTICE).astype(int)
    taken = np.zeros((int(cells[0]), int(cells[1]), int(cells[2])), np.bool_)
    found = []
    for T, image in zip(poses, images):
        seen = np.isfinite(image)
        points = np.asarray(lens.deproject(image)[seen] @ T[:3, :3].T + T[:3, 3], np.float32)
        mark(points, origin, grid.voxel, divided, state)
        found.append(thinned(points, bottom, LATTICE, taken))
    hidden = thinned(hidden, bottom, LATTICE, taken)
    return Seen(grid, state, _among(grid, divided, np.concatenate(found)), hidden)


def _among(grid: VoxelGrid, mask: Mask, points: Floats32) -> Floats32:
    """The points that lie in a voxel of a mask."""
    index = grid.index(points)
    inside = np.all((index >= 0) & (index < grid.shape), axis=1)
    inside[inside] = mask[tuple(index[inside].T)]
    return points[inside]


def snapshot_of(seen: Seen, unseen_is_solid: bool) -> DetailedSnapshot:
    """A snapshot for the planner alone: nobody is a hazard, nothing is remembered.

    Where unseen space is free, only what was seen is solid: the cubes of voxels that were not
    looked at in detail and hold a point of a surface, and the points elsewhere.
    """
    grid, state, points = seen.grid, seen.state, seen.surface
    if unseen_is_solid:
        points = np.concatenate([points, seen.hidden])
    solid = state != FREE if unseen_is_solid else state == OCCUPIED
    state = np.where(solid, state, np.uint8(FREE))
    detail = make_detail(grid, points)
    solid[tuple(grid.index(detail.points).T)] = True
    nothing = np.empty((0, 3), np.float32)
    return DetailedSnapshot(
        sequence=0,
        stamp=0.0,
        oldest=0.0,
        grid=grid,
        state=state,
        distance=bounded_distance(solid, grid.voxel, CAP * grid.voxel),
        distance_cap=CAP * grid.voxel,
        last_occupied=np.full(grid.shape, -np.inf, np.float32),
        hazards=nothing,
        hazard_radius=0.5 * math.sqrt(3.0) * grid.voxel,
        hazard_unknown=np.zeros(0, bool),
        cloud=nothing,
        cameras=(),
        distance_counts_unknown=unseen_is_solid,
        detail=detail,
    )


def _pyramid(depth: Floats32) -> list[tuple[Floats32, Floats32]]:
    """Least and greatest depth of squares of 1, 2, 4 ... pixels."""
    levels = [(depth, depth)]
    while min(levels[-1][0].shape) > 2:
        a, b = levels[-1]
        rows, columns = a.shape[0] % 2, a.shape[1] % 2
        a = np.pad(a, ((0, rows), (0, columns)), mode="edge")
        b = np.pad(b, ((0, rows), (0, columns)), mode="edge")
        low = np.minimum(
            np.minimum(a[::2, ::2], a[1::2, ::2]), np.minimum(a[::2, 1::2], a[1::2, 1::2])
        )
        high = np.maximum(
            np.maximum(b[::2, ::2], b[1::2, ::2]), np.maximum(b[::2, 1::2], b[1::2, 1::2])
        )
        levels.append((low, high))
    return levels
