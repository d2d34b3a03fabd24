"""Sets a place upright that was scanned by a hand-held camera: which way is up, where is the floor.

Up begins as the mean of the images' up and settles on the mean normal of the surfaces that face
that way (tables, floors), as people hold a camera level only roughly but build shelves level well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Points, Pose, Vector3
from armsight.geometry.pose import make_pose, transform

CONES_DEG = (35.0, 20.0, 10.0, 5.0, 5.0)
"""Normals within these angles of the present guess make the next one."""
LEAST = 200
"""Fewer normals than this say nothing."""


def upright(views: Sequence[tuple[Points, Pose]]) -> tuple[Pose, Vector3, Vector3]:
    """Base frame of a place: z up, its lowest surface at z = 0, what is mostly seen at x = y = 0.

    Args:
        views: (h, w, 3) points [m] in the camera's frame (NaN for none) and ``T_world_camera``.

    Returns:
        ``T_base_world``, and the lower and upper corner [m] in base of what the views see.
    """
    up = np.mean([-T[:3, 1] for _, T in views], axis=0)
    up = up / np.linalg.norm(up)
    normals = np.concatenate([_normals(points) @ T[:3, :3].T for points, T in views])
    for cone in CONES_DEG:
        close = normals[normals @ up > np.cos(np.deg2rad(cone))]
        if len(close) < LEAST:
            break
        up = close.mean(axis=0)
        up = up / np.linalg.norm(up)
    forward = views[0][1][:3, 2]
    x = forward - (forward @ up) * up
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-6 else np.linalg.svd(up[None])[2][1]
    turn = make_pose(np.stack([x, np.cross(up, x), up]))
    seen = [transform(turn @ T, p[np.isfinite(p[..., 2])]) for p, T in views]
    points = np.concatenate([*seen, np.zeros((0, 3))])
    if not len(points):
        return turn, np.full(3, -1.0), np.full(3, 1.0)
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    origin = np.array([*np.median(points[:, :2], axis=0), low[2]])
    return make_pose(None, -origin) @ turn, low - origin, high - origin


def _normals(points: Points) -> Points:
    """(n, 3) unit normals, towards the camera, of the flat spots of a grid of points."""
    right = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    depth = points[1:-1, 1:-1, 2]
    with np.errstate(invalid="ignore"):
        jump = np.maximum(np.abs(right[..., 2]), np.abs(down[..., 2])) > 0.1 * depth
        n = np.cross(down, right)
        length = np.linalg.norm(n, axis=-1)
        good = np.isfinite(length) & (length > 1e-9) & ~jump
    n = n[good] / length[good][:, None]
    # Towards the camera: against the ray.
    ray = points[1:-1, 1:-1][good]
    return np.where((np.sum(n * ray, axis=1) > 0)[:, None], -n, n)
