"""Scenes of simple solids through perfect depth cameras, and what a voxel grid learns from them.

For problem sets that come as boxes and cylinders: pictures by ray casting, and a grid as the map
would make it, at any voxel: occupied where a pixel's point lies, free only where one picture saw
through the whole voxel, else unknown. Nothing moves here and nothing is noisy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.ndimage import minimum_filter

from armsight.arrays import Bytes, DepthImage, Floats, Floats32, Mask, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid, WorkspaceSnapshot

BOX, CYLINDER = 0, 1
COARSE = 4
"""Fine voxels along the edge of a coarse one, for distances beyond the fine field's reach."""
FINE_CAP, COARSE_CAP = 15, 15
"""Reach of the two distance fields, in their voxels."""


def look_at(eye: Vector3, target: Vector3) -> Pose:
    """Optical pose (z ahead, x right, y down) of a camera at ``eye`` that looks at ``target``."""
    ahead = np.asarray(target, float) - eye
    ahead /= np.linalg.norm(ahead)
    up = np.array([0.0, 0.0, 1.0]) if abs(ahead[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    return make_pose(np.stack([right, np.cross(ahead, right), ahead], axis=1), eye)


def depth_image(solids: Sequence[Solid], lens: PinholeCamera, T_base_camera: Pose) -> DepthImage:
    """(h, w) float32 depth along the optical axis [m]; NaN where nothing is."""
    kinds = np.array([BOX if s.kind == "box" else CYLINDER for s in solids], np.int64)
    sizes = np.array([s.size for s in solids], float).reshape(-1, 3)
    poses = [inverse(s.T_frame_solid) @ T_base_camera for s in solids]
    T = np.array(poses, float).reshape(-1, 4, 4)
    rays = np.concatenate([lens.rays, np.ones((lens.height, lens.width, 1))], axis=2)
    return np.asarray(_cast(kinds, sizes, T, rays.reshape(-1, 3))).reshape(lens.height, lens.width)


@njit(cache=True, nogil=True)
def _cast(kinds: np.ndarray, sizes: Floats, T: Floats, rays: Floats) -> Floats32:
    """Depth [m] of each ray (z = 1) from the camera's origin."""
    out = np.full(rays.shape[0], np.nan, np.float32)
    for r in range(rays.shape[0]):
        best = np.inf
        for k in range(kinds.shape[0]):
            p, d = np.empty(3), np.empty(3)
            for i in range(3):
                p[i] = T[k, i, 3]
                d[i] = T[k, i, 0] * rays[r, 0] + T[k, i, 1] * rays[r, 1] + T[k, i, 2] * rays[r, 2]
            near, far = 0.0, best
            flat = 3
            if kinds[k] == CYLINDER:
                a = d[0] * d[0] + d[1] * d[1]
                b = p[0] * d[0] + p[1] * d[1]
                c = p[0] * p[0] + p[1] * p[1] - sizes[k, 0] * sizes[k, 0]
                square = b * b - a * c
                if a < 1e-15:
                    if c > 0.0:
                        continue
                elif square < 0.0:
                    continue
                else:
                    root = math.sqrt(square)
                    near, far = max(near, (-b - root) / a), min(far, (-b + root) / a)
                flat = 1
            for n in range(flat):
                i = 2 if flat == 1 else n
                half = 0.5 * (sizes[k, 1] if flat == 1 else sizes[k, i])
                if abs(d[i]) < 1e-15:
                    if abs(p[i]) > half:
                        near = np.inf
                    continue
                t0, t1 = (-half - p[i]) / d[i], (half - p[i]) / d[i]
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
            if near <= far and 0.0 < near < best:
                best = near
        if best < np.inf:
            out[r] = best
    return out


def voxels_seen(
    grid: VoxelGrid, lens: PinholeCamera, poses: Sequence[Pose], images: Sequence[DepthImage]
) -> Bytes:
    """(nx, ny, nz) states after these pictures: OCCUPIED, FREE or UNKNOWN."""
    state = np.full(grid.shape, UNKNOWN, np.uint8)
    reach = 0.5 * math.sqrt(3.0) * grid.voxel
    for T, image in zip(poses, images):
        depth = np.where(np.isnan(image), np.float32(np.inf), image)
        # Squares of pixels that hold a voxel's whole picture, by distance.
        pooled = {half: _pooled(depth, half) for half in (1, 2, 3, 4, 6, 8, 12)}
        halves = np.array(list(pooled), np.int64)
        layers = np.stack(list(pooled.values()))
        K = np.array([lens.fx, lens.fy, lens.cx, lens.cy])
        _carve(
            state, np.asarray(grid.origin, float), grid.voxel, inverse(T), K, halves, layers, reach
        )
    for T, image in zip(poses, images):
        seen = np.isfinite(image)
        points = lens.deproject(image)[seen].astype(float) @ T[:3, :3].T + T[:3, 3]
        index = grid.index(points)
        index = index[((index >= 0) & (index < grid.shape)).all(axis=1)]
        state[tuple(index.T)] = OCCUPIED
    return state


def _pooled(depth: Floats32, half: int) -> Floats32:
    """Least depth within ``half`` pixels; nothing is known beyond the picture's border."""
    return np.asarray(minimum_filter(depth, 2 * half + 1, mode="constant", cval=0.0), np.float32)


@njit(cache=True, nogil=True)
def _carve(
    state: Bytes,
    origin: Floats,
    voxel: float,
    T_camera_base: Pose,
    K: Floats,
    halves: np.ndarray,
    layers: Floats32,
    reach: float,
) -> None:
    """Mark voxels FREE that one picture saw through, all of them."""
    nx, ny, nz = state.shape
    height, width = layers.shape[1], layers.shape[2]
    R, t = T_camera_base[:3, :3], T_camera_base[:3, 3]
    for ix in range(nx):
        for iy in range(ny):
            for iz in range(nz):
                if state[ix, iy, iz] == FREE:
                    continue
                x = origin[0] + (ix + 0.5) * voxel
                y = origin[1] + (iy + 0.5) * voxel
                z = origin[2] + (iz + 0.5) * voxel
                cz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2]
                if cz - reach < 0.05:
                    continue
                u = K[0] * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0]) / cz + K[2]
                v = K[1] * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1]) / cz + K[3]
                column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                if column < 0 or row < 0 or column >= width or row >= height:
                    continue
                # Off the axis a cube looks larger in the picture, by at most 1 / cos.
                aside = math.sqrt(1.0 + ((u - K[2]) / K[0]) ** 2 + ((v - K[3]) / K[1]) ** 2)
                wanted = max(K[0], K[1]) * reach * aside / (cz - reach) + 0.5
                for n in range(halves.shape[0]):
                    if halves[n] >= wanted:
                        if layers[n, row, column] > cz + reach:
                            state[ix, iy, iz] = FREE
                        break


def snapshot_of(grid: VoxelGrid, state: Bytes, unseen_is_solid: bool) -> WorkspaceSnapshot:
    """A snapshot for the planner alone: nobody is a hazard, nothing is remembered.

    The distance field is the greater of a fine and a coarse bound: both hold.
    """
    solid = state != FREE if unseen_is_solid else state == OCCUPIED
    fine = bounded_distance(solid, grid.voxel, FINE_CAP * grid.voxel)
    coarse = _coarse_bound(solid, grid.voxel)
    distance = np.maximum(fine, coarse)
    nothing = np.empty((0, 3), np.float32)
    return WorkspaceSnapshot(
        sequence=0,
        stamp=0.0,
        oldest=0.0,
        grid=grid,
        state=state if unseen_is_solid else np.where(solid, state, np.uint8(FREE)),
        distance=distance,
        distance_cap=COARSE_CAP * COARSE * grid.voxel,
        last_occupied=np.full(grid.shape, -np.inf, np.float32),
        hazards=nothing,
        hazard_radius=0.5 * math.sqrt(3.0) * grid.voxel,
        hazard_unknown=np.zeros(0, bool),
        cloud=nothing,
        cameras=(),
        distance_counts_unknown=unseen_is_solid,
    )


def _coarse_bound(solid: Mask, voxel: float) -> Floats32:
    """A bound for every fine voxel, from cubes four times as large."""
    shape = solid.shape
    padded = np.pad(solid, [(0, -n % COARSE) for n in shape])
    nx, ny, nz = (n // COARSE for n in padded.shape)
    parts = padded.reshape(nx, COARSE, ny, COARSE, nz, COARSE)
    blocks = np.asarray(parts.any(axis=(1, 3, 5)), bool)
    edge = COARSE * voxel
    bound = bounded_distance(blocks, edge, COARSE_CAP * edge)
    for axis in range(3):
        bound = np.repeat(bound, COARSE, axis=axis)
    return np.ascontiguousarray(bound[: shape[0], : shape[1], : shape[2]])
