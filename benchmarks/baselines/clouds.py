"""Point clouds as T2 handles them: crop, thin, drop outliers, align by ICP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from armsight.arrays import Mask, Points, Pose, Vector3

Method = Literal["ICP", "PLANE_ICP", "GICP"]


def within_sphere(points: Points, center: Vector3, radius: float) -> Mask:
    """(n,) whether each of (n, 3) points lies within ``radius`` [m] of a centre (T2: 1500 mm)."""
    difference = np.asarray(points) - np.asarray(center)
    return np.asarray((difference**2).sum(axis=1) <= radius**2)


def voxel_centroids(points: Points, voxel: float, origin: Vector3 | None = None) -> Points:
    """One point for each voxel that holds any: the centroid of its points (T2's voxel grid).

    Args:
        points: (n, 3) [m]; those that are not finite are left out.
        voxel: edge of a voxel [m].
        origin: a corner of some voxel [m]; zero if absent.

    Returns:
        (m, 3) centroids, in the order of the voxels' indices.

    Raises:
        ValueError: the voxel is not positive.
    """
    if not voxel > 0:
        raise ValueError(f"voxel is {voxel} m; expected more than 0")
    p = np.asarray(points, float).reshape(-1, 3)
    p = p[np.isfinite(p).all(axis=1)]
    if len(p) == 0:
        return np.empty((0, 3))
    start = np.zeros(3) if origin is None else np.asarray(origin, float)
    index = np.floor((p - start) / voxel).astype(np.int64)
    index -= index.min(axis=0)
    span = index.max(axis=0) + 1
    key = (index[:, 0] * span[1] + index[:, 1]) * span[2] + index[:, 2]
    _, member, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(member, p[:, d], len(count)) for d in range(3)], axis=1)
    return np.asarray(sums / count[:, None])


def statistical_inliers(points: Points, neighbors: int = 16, ratio: float = 2.0) -> Mask:
    """(n,) which points are no outliers by their mean distance to their nearest neighbours.

    A point is an outlier if that mean exceeds the cloud's mean of it by more than ``ratio``
    standard deviations (Rusu et al. 2008, "Towards 3D point cloud based object maps").

    Args:
        points: (n, 3) finite points [m].
        neighbors: how many neighbours are looked at.
        ratio: how many standard deviations are allowed.
    """
    p = np.asarray(points, float).reshape(-1, 3)
    k = min(neighbors, len(p) - 1)
    if k < 1:
        return np.ones(len(p), bool)
    distance, _ = cKDTree(p).query(p, k + 1)
    mean = np.asarray(distance)[:, 1:].mean(axis=1)
    return np.asarray(mean <= mean.mean() + ratio * mean.std(), bool)


@dataclass(frozen=True)
class Registration:
    """The result of ICP.

    Attributes:
        T_target_source: the pose found.
        inliers: source points with a target point close enough.
        error: root mean square of the inliers' residuals, in the method's own measure.
        converged: whether the steps had become small.
    """

    T_target_source: Pose
    inliers: int
    error: float
    converged: bool


def icp(
    source: Points,
    target: Points,
    start: Pose | None = None,
    *,
    reach: float = 0.05,
    voxel: float = 0.02,
    method: Method = "GICP",
    iterations: int = 30,
) -> Registration:
    """Fine registration of two clouds that nearly fit, by small_gicp.

    Args:
        source: (n, 3) points [m].
        target: (m, 3) points [m].
        start: ``T_target_source`` to begin with; the identity if absent.
        reach: points farther apart than this do not belong together [m].
        voxel: both clouds are thinned to one point in this [m].
        method: point to point, point to plane, or plane to plane.
        iterations: at most so many.

    Raises:
        ValueError: a cloud has fewer than 20 finite points.
    """
    clouds = []
    for name, points in (("source", source), ("target", target)):
        p = np.asarray(points, np.float64).reshape(-1, 3)
        p = np.ascontiguousarray(p[np.isfinite(p).all(axis=1)])
        if len(p) < 20:
            raise ValueError(f"icp: the {name} has {len(p)} finite points; expected at least 20")
        clouds.append(p)
    result = small_gicp.align(
        clouds[1],
        clouds[0],
        init_T_target_source=np.eye(4) if start is None else np.asarray(start, float),
        registration_type=method,
        downsampling_resolution=voxel,
        max_correspondence_distance=reach,
        num_threads=1,
        max_iterations=iterations,
        rotation_epsilon=1e-5,
        translation_epsilon=1e-5,
    )
    error = float(np.sqrt(max(result.error, 0.0) / max(result.num_inliers, 1)))
    T = np.asarray(result.T_target_source, float)
    return Registration(T, int(result.num_inliers), error, bool(result.converged))
