"""Rigid registration of matched points, in closed form."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Points, Pose
from armsight.geometry.pose import make_pose


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
