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
from numba import njit

from armsight.arrays import Bytes, DepthImage, Floats, Floats32, Mask, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.motion.detail import DetailedSnapshot, make_detail

HIDDEN, PARTLY, ENTERED, THROUGH = 0, 1, 2, 3
"""What a picture saw of a cube: nothing, something, into all of it, through all of it."""
BLOCK = 4
"""Voxels along the edge of a cube that is looked at first."""
PARTS = 8
"""Small cubes along the edge of a voxel."""
LATTICE = 0.002
"""Of points in the same cube of this edge [m] one is kept."""
NEAREST = 0.05
"""Nothing nearer to a camera is judged [m]."""
CAP = 15
"""Reach of the distance field [voxels]."""
WIDEST = 4
"""Texels that a picture of a cube spans at most; larger ones use a coarser level."""


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
    hidden = _classify(state, divided, origin, grid.voxel, views, K, low, high, sizes, begins)
    index = np.argwhere(divided) if divided.any() else np.zeros((1, 3), np.int64)
    bottom = grid.origin + index.min(axis=0) * grid.voxel
    cells = np.ceil((index.max(axis=0) + 1 - index.min(axis=0)) * grid.voxel / LATTICE).astype(int)
    taken = np.zeros((int(cells[0]), int(cells[1]), int(cells[2])), np.bool_)
    found = []
    for T, image in zip(poses, images):
        seen = np.isfinite(image)
        points = np.asarray(lens.deproject(image)[seen] @ T[:3, :3].T + T[:3, 3], np.float32)
        _mark(points, origin, grid.voxel, divided, state)
        found.append(_thinned(points, bottom, LATTICE, taken))
    hidden = _thinned(hidden, bottom, LATTICE, taken)
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


@njit(cache=True, nogil=True)
def _mark(points: Floats32, origin: Floats, voxel: float, divided: Mask, state: Bytes) -> None:
    """Write OCCUPIED to the voxels that hold a point and are not divided."""
    for k in range(points.shape[0]):
        x = int(np.floor((points[k, 0] - origin[0]) / voxel))
        y = int(np.floor((points[k, 1] - origin[1]) / voxel))
        z = int(np.floor((points[k, 2] - origin[2]) / voxel))
        if x < 0 or y < 0 or z < 0:
            continue
        inside = x < state.shape[0] and y < state.shape[1] and z < state.shape[2]
        if inside and not divided[x, y, z]:
            state[x, y, z] = OCCUPIED


@njit(cache=True, nogil=True)
def _thinned(points: Floats32, origin: Floats, edge: float, taken: Mask) -> Floats32:
    """The points that are the first in their cell of a lattice; those outside are left out."""
    out = np.empty_like(points)
    count = 0
    for k in range(points.shape[0]):
        x = int(np.floor((points[k, 0] - origin[0]) / edge))
        y = int(np.floor((points[k, 1] - origin[1]) / edge))
        z = int(np.floor((points[k, 2] - origin[2]) / edge))
        if x < 0 or y < 0 or z < 0:
            continue
        if x >= taken.shape[0] or y >= taken.shape[1] or z >= taken.shape[2] or taken[x, y, z]:
            continue
        taken[x, y, z] = True
        out[count] = points[k]
        count += 1
    return out[:count]


@njit(cache=True, nogil=True)
def _seen(
    x: float,
    y: float,
    z: float,
    reach: float,
    T: Pose,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    last: bool,
) -> int:
    """What one picture saw of the ball of radius ``reach`` about a point.

    With ``last`` hidden is not told from seen partly, as nothing is divided further.
    """
    cz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if cz + reach < NEAREST:
        return HIDDEN
    if cz - reach < NEAREST:
        return PARTLY
    a = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / cz
    b = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / cz
    # Off the axis a ball looks larger in the picture, by at most 1 / cos.
    wide = reach * math.sqrt(1.0 + a * a + b * b) / (cz - reach)
    u, v = K[0] * a + K[2], K[1] * b + K[3]
    u0, u1 = int(np.floor(u - K[0] * wide)), int(np.ceil(u + K[0] * wide))
    v0, v1 = int(np.floor(v - K[1] * wide)), int(np.ceil(v + K[1] * wide))
    height, width = sizes[0]
    if u1 < 0 or v1 < 0 or u0 >= width or v0 >= height:
        return HIDDEN
    if u0 < 0 or v0 < 0 or u1 >= width or v1 >= height:
        return PARTLY
    level = 0
    while max(u1 - u0, v1 - v0) >> level > WIDEST:
        level += 1
    columns, begin = sizes[level, 1], begins[level]
    least, most = np.inf, 0.0
    for row in range(v0 >> level, (v1 >> level) + 1):
        for column in range(u0 >> level, (u1 >> level) + 1):
            k = begin + row * columns + column
            least = min(least, low[k])
            if least < cz - reach and (last or most >= cz - reach):
                return PARTLY
            most = max(most, high[k])
    if least > cz + reach:
        return THROUGH
    if least >= cz - reach:
        return ENTERED
    return PARTLY if most >= cz - reach else HIDDEN


@njit(cache=True, nogil=True)
def _best(
    x: float,
    y: float,
    z: float,
    reach: float,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    mask: int,
    last: bool,
    first: np.ndarray,
) -> tuple[int, int]:
    """The best that the pictures in a mask saw of a ball, and those that saw any of it.

    ``first`` holds the picture to begin with: the one that told enough the last time.
    """
    best, some = HIDDEN, 0
    count = views.shape[0]
    begin = first[0]
    for n in range(count):
        c = (begin + n) % count
        if mask >> c & 1:
            seen = _seen(x, y, z, reach, views[c], K, low[c], high[c], sizes, begins, last)
            if seen == THROUGH or (last and seen == ENTERED):
                first[0] = c
                return seen, mask
            if seen > HIDDEN:
                some |= 1 << c
            best = max(best, seen)
    return best, some


@njit(cache=True, nogil=True)
def _classify(
    state: Bytes,
    divided: Mask,
    origin: Floats,
    voxel: float,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
) -> Floats32:
    """Write FREE to voxels that are not wholly hidden; returns the hidden places within them."""
    nx, ny, nz = state.shape
    small = np.empty((PARTS, PARTS, PARTS), np.bool_)
    stack = np.empty((64, 5), np.int64)
    first = np.zeros(1, np.int64)
    room = 1 << 16
    out = np.empty((room, 3), np.float32)
    count = 0
    root3 = math.sqrt(3.0)
    edge = voxel / PARTS
    every = (1 << views.shape[0]) - 1
    for block in range(-(-nx // BLOCK) * -(-ny // BLOCK) * -(-nz // BLOCK)):
        i, rest = divmod(block, -(-ny // BLOCK) * -(-nz // BLOCK))
        j, k = divmod(rest, -(-nz // BLOCK))
        i, j, k = i * BLOCK, j * BLOCK, k * BLOCK
        h = 0.5 * BLOCK * voxel
        x0, y0, z0 = origin[0] + i * voxel, origin[1] + j * voxel, origin[2] + k * voxel
        best, mask = _best(
            x0 + h, y0 + h, z0 + h, root3 * h,
            views, K, low, high, sizes, begins, every, False, first,
        )  # fmt: skip
        if best == THROUGH:
            state[i : i + BLOCK, j : j + BLOCK, k : k + BLOCK] = FREE
            continue
        if mask == 0:
            continue
        for ix in range(i, min(i + BLOCK, nx)):
            for iy in range(j, min(j + BLOCK, ny)):
                for iz in range(k, min(k + BLOCK, nz)):
                    x0, y0 = origin[0] + ix * voxel, origin[1] + iy * voxel
                    z0 = origin[2] + iz * voxel
                    h = 0.5 * voxel
                    best, some = _best(
                        x0 + h, y0 + h, z0 + h, root3 * h,
                        views, K, low, high, sizes, begins, mask, False, first,
                    )  # fmt: skip
                    if best == THROUGH:
                        state[ix, iy, iz] = FREE
                        continue
                    if some == 0 or not divided[ix, iy, iz]:
                        continue
                    small[:] = False
                    _divide(
                        x0, y0, z0, edge, some, small, stack,
                        views, K, low, high, sizes, begins, first,
                    )  # fmt: skip
                    if not small.any():
                        continue
                    state[ix, iy, iz] = FREE
                    if room - count < PARTS**3:
                        room *= 2
                        grown = np.empty((room, 3), np.float32)
                        grown[:count] = out[:count]
                        out = grown
                    for a in range(PARTS):
                        for b in range(PARTS):
                            for c in range(PARTS):
                                if not small[a, b, c] and _open(small, a, b, c):
                                    out[count, 0] = x0 + (a + 0.5) * edge
                                    out[count, 1] = y0 + (b + 0.5) * edge
                                    out[count, 2] = z0 + (c + 0.5) * edge
                                    count += 1
    return out[:count].copy()


@njit(cache=True, nogil=True)
def _open(small: Mask, a: int, b: int, c: int) -> bool:
    """Whether a small cube has a neighbour that is seen, or may have one in the next voxel."""
    last = PARTS - 1
    if a == 0 or b == 0 or c == 0 or a == last or b == last or c == last:
        return True
    return (
        small[a - 1, b, c]
        or small[a + 1, b, c]
        or small[a, b - 1, c]
        or small[a, b + 1, c]
        or small[a, b, c - 1]
        or small[a, b, c + 1]
    )


@njit(cache=True, nogil=True)
def _divide(
    x0: float,
    y0: float,
    z0: float,
    edge: float,
    mask: int,
    small: Mask,
    stack: np.ndarray,
    views: Floats,
    K: Floats,
    low: Floats32,
    high: Floats32,
    sizes: np.ndarray,
    begins: np.ndarray,
    first: np.ndarray,
) -> None:
    """Mark the small cubes of a voxel that some picture of a mask saw, block by smaller block."""
    stack[0, :3] = 0
    stack[0, 3], stack[0, 4] = PARTS, mask
    count = 1
    while count > 0:
        count -= 1
        i, j, k, width, some = stack[count]
        half = width // 2
        h = 0.5 * half * edge
        for a in range(i, i + width, half):
            for b in range(j, j + width, half):
                for c in range(k, k + width, half):
                    x, y, z = x0 + a * edge + h, y0 + b * edge + h, z0 + c * edge + h
                    best, left = _best(
                        x,
                        y,
                        z,
                        math.sqrt(3.0) * h,
                        views,
                        K,
                        low,
                        high,
                        sizes,
                        begins,
                        some,
                        half == 1,
                        first,
                    )
                    if best == THROUGH or (half == 1 and best == ENTERED):
                        small[a : a + half, b : b + half, c : c + half] = True
                    elif half > 1 and left != 0:
                        stack[count, 0], stack[count, 1], stack[count, 2] = a, b, c
                        stack[count, 3], stack[count, 4] = half, left
                        count += 1
