"""Rigid registration: of matched points in closed form, of clouds by ICP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import small_gicp

from armsight.arrays import Floats, Points, Pose
from armsight.geometry.pose import make_pose

Method = Literal["ICP", "PLANE_ICP", "GICP"]


def procrustes(source: Points, target: Points, weights: Floats | None = None) -> Pose:
    """The rigid ``T_target_source`` of least squared distance between matched points.

    Closed form by singular values (Arun, Huang, Blostein 1987; Umeyama 1991), reflections excluded.

    Args:
        source: (n, 3) points [m].
        target: (n, 3) the same points in the target frame [m].
        weights: (n,) non-negative, or None for all alike.

    Raises:
        ValueError: the shapes differ, there are fewer than three points, or they lie on a line.
    """
    a, b = np.asarray(source, float), np.asarray(target, float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise ValueError(f"procrustes: shapes {a.shape} and {b.shape}; expected (n, 3) twice")
    if len(a) < 3:
        raise ValueError(f"procrustes: {len(a)} points; expected at least 3")
    w = np.ones(len(a)) if weights is None else np.asarray(weights, float)
    w = w / w.sum()
    mean_a, mean_b = w @ a, w @ b
    U, s, Vt = np.linalg.svd((a - mean_a).T @ ((b - mean_b) * w[:, None]))
    if s[1] < 1e-12 * max(s[0], 1e-30):
        raise ValueError("procrustes: the points lie on a line; their rotation is not determined")
    sign = np.sign(np.linalg.det(U @ Vt))
    R = Vt.T @ np.diag([1.0, 1.0, sign]) @ U.T
    return make_pose(R, mean_b - R @ mean_a)


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
