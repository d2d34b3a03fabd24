"""Kernels of the fit of spheres and capsules to links: surfaces, neighbours, pairs of links."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import Floats, Ints, JointPath, Points, Poses
from armsight.robots.kernels import chain_poses_into


@njit(cache=True, nogil=True)
def triangle_lattices(corners: Floats, spacing: float) -> Points:
    """Rows parallel to each triangle's shortest edge, from the corner opposite to it."""
    total = 0
    out = np.empty((0, 3))
    for fill in range(2):  # first count, then write
        at = 0
        for f in range(corners.shape[0]):
            best, short = 0, np.inf
            for e in range(3):
                d = corners[f, (e + 2) % 3] - corners[f, (e + 1) % 3]
                length = np.sqrt(np.sum(d * d))
                if length < short:
                    best, short = e, length
            tip = corners[f, best]
            left = corners[f, (best + 1) % 3]
            right = corners[f, (best + 2) % 3]
            a, b = left - tip, right - tip
            high = max(np.sqrt(np.sum(a * a)), np.sqrt(np.sum(b * b)))
            rows = int(np.ceil(high / spacing)) if high > 0.0 else 0
            for i in range(rows + 1):
                t = i / rows if rows else 0.0
                columns = int(np.ceil(t * short / spacing))
                for j in range(columns + 1):
                    if fill:
                        u = j / columns if columns else 0.0
                        for c in range(3):
                            out[at, c] = tip[c] + t * (a[c] + u * (b[c] - a[c]))
                    at += 1
        if not fill:
            total = at
            out = np.empty((total, 3))
    return out


@njit(cache=True, nogil=True)
def nearer(
    points: Points,
    bound: Floats,
    skin: Points,
    T_other_link: Poses,
    origin: Floats,
    voxel: float,
    distance: Floats,
) -> tuple[Floats, int]:
    """In how many free configurations the other link is nearer than a bound, and how many are."""
    count = np.zeros(points.shape[0])
    free = 0
    for c in range(T_other_link.shape[0]):
        T = T_other_link[c]
        touches = False
        for k in range(skin.shape[0]):
            if _look(skin[k], T, origin, voxel, distance) <= 0.0:
                touches = True
                break
        if touches:
            continue
        free += 1
        for k in range(points.shape[0]):
            if _look(points[k], T, origin, voxel, distance) < bound[k]:
                count[k] += 1.0
    return count, free


@njit(cache=True, nogil=True)
def _look(point: Floats, T: Floats, origin: Floats, voxel: float, distance: Floats) -> float:
    """The field at a point that a pose carries into its frame; infinite beyond it."""
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    i = int(np.floor((x - origin[0]) / voxel))
    j = int(np.floor((y - origin[1]) / voxel))
    m = int(np.floor((z - origin[2]) / voxel))
    nx, ny, nz = distance.shape
    if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
        return distance[i, j, m]
    return np.inf


@njit(cache=True, nogil=True)
def sphere_gaps(
    path: JointPath,
    T_link_joint: Poses,
    axis: Points,
    link: Ints,
    center: Points,
    radius: Floats,
    pairs: Ints,
) -> Floats:
    """(k, p) least gap [m] between the spheres of each pair of links at each configuration."""
    out = np.full((path.shape[0], pairs.shape[0]), np.inf)
    poses = np.empty((path.shape[1] + 1, 4, 4))
    at = np.empty((link.shape[0], 3))
    for c in range(path.shape[0]):
        chain_poses_into(path[c], T_link_joint, axis, poses)
        for s in range(link.shape[0]):
            T = poses[link[s]]
            for r in range(3):
                at[s, r] = (
                    T[r, 0] * center[s, 0] + T[r, 1] * center[s, 1] + T[r, 2] * center[s, 2]
                ) + T[r, 3]
        for p in range(pairs.shape[0]):
            for a in range(link.shape[0]):
                if link[a] != pairs[p, 0]:
                    continue
                for b in range(link.shape[0]):
                    if link[b] != pairs[p, 1]:
                        continue
                    x, y, z = at[a, 0] - at[b, 0], at[a, 1] - at[b, 1], at[a, 2] - at[b, 2]
                    gap = np.sqrt(x * x + y * y + z * z) - radius[a] - radius[b]
                    out[c, p] = min(out[c, p], gap)
    return out


@njit(cache=True, nogil=True)
def mesh_touches(
    path: JointPath,
    T_link_joint: Poses,
    axis: Points,
    a: int,
    b: int,
    points: Points,
    origin: Floats,
    voxel: float,
    inside: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """(k,) whether a point of link a lies in a voxel of link b at each configuration."""
    out = np.zeros(path.shape[0], np.bool_)
    poses = np.empty((path.shape[1] + 1, 4, 4))
    for c in range(path.shape[0]):
        chain_poses_into(path[c], T_link_joint, axis, poses)
        A, B = poses[a], poses[b]
        R = B[:3, :3].T.copy() @ A[:3, :3].copy()
        t = B[:3, :3].T.copy() @ (A[:3, 3] - B[:3, 3])
        for k in range(points.shape[0]):
            v = R @ points[k] + t
            i = int(np.floor((v[0] - origin[0]) / voxel))
            j = int(np.floor((v[1] - origin[1]) / voxel))
            m = int(np.floor((v[2] - origin[2]) / voxel))
            if (
                0 <= i < inside.shape[0]
                and 0 <= j < inside.shape[1]
                and 0 <= m < inside.shape[2]
                and inside[i, j, m]
            ):
                out[c] = True
                break
    return out
