"""Corners from the board to the pixel: the steps between, projection, derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Poses


@dataclass(frozen=True)
class Chain:
    """Corners on their way from the board to the lens, with the poses between.

    Attributes:
        T_board, T_arm, T_rig_mount, T_lens_rig: (F, 4, 4) what each step applies.
        late: (F, 4, 4) motion of the flange between the arm's clock and the camera's.
        B_theta: (V, 6, t) how the arm's errors turn each pose (body twist).
        X: (F, K, 3) the corners on the board; at_arm, at_mount, at_rig, at_lens: after each step.
    """

    T_board: Poses
    T_arm: Poses
    T_rig_mount: Poses
    T_lens_rig: Poses
    late: Poses
    B_theta: Floats
    X: Floats
    at_arm: Floats
    at_mount: Floats
    at_rig: Floats
    at_lens: Floats


def project(
    points: Floats, lens: Floats, derivatives: bool = True
) -> tuple[Floats, Floats, Floats]:
    """Brown-Conrady projection with its derivatives.

    Args:
        points: (f, k, 3) in the lens's frame [m].
        lens: (f, 9) numbers of each lens.
        derivatives: whether to compute them.

    Returns:
        (f, k, 2) pixels, (f, k, 2, 3) by the point, (f, k, 2, 9) by the lens. A point behind the
        lens is treated as if 1 mm in front of it, so that a solver sees a huge, finite error.
    """
    z = np.maximum(points[..., 2], 1e-3)
    x, y = points[..., 0] / z, points[..., 1] / z
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = (lens[:, None, i] for i in range(9))
    xx, yy, xy = x * x, y * y, x * y
    r2 = np.minimum(xx + yy, 4.0)
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * xy + p2 * (r2 + 2 * xx)
    yd = y * radial + p1 * (r2 + 2 * yy) + 2 * p2 * xy
    pixel = np.stack([fx * xd + cx, fy * yd + cy], axis=-1)
    if not derivatives:
        empty = np.empty((0,))
        return pixel, empty, empty
    slope = k1 + r2 * (2 * k2 + 3 * k3 * r2)  # of radial by r2
    d = np.empty((*x.shape, 2, 2))  # distorted by undistorted
    d[..., 0, 0] = radial + 2 * xx * slope + 2 * p1 * y + 6 * p2 * x
    d[..., 0, 1] = 2 * xy * slope + 2 * p1 * x + 2 * p2 * y
    d[..., 1, 0] = 2 * xy * slope + 2 * p1 * x + 2 * p2 * y
    d[..., 1, 1] = radial + 2 * yy * slope + 6 * p1 * y + 2 * p2 * x
    f = np.stack([np.broadcast_to(fx, x.shape), np.broadcast_to(fy, x.shape)], axis=-1)
    d = d * f[..., None]
    inv_z = 1 / z
    d_point = np.empty((*x.shape, 2, 3))
    d_point[..., :2] = d * inv_z[..., None, None]
    d_point[..., 2] = -(d[..., 0] * x[..., None] + d[..., 1] * y[..., None]) * inv_z[..., None]
    d_lens = np.zeros((*x.shape, 2, 9))
    d_lens[..., 0, 0], d_lens[..., 1, 1] = xd, yd
    d_lens[..., 0, 2] = d_lens[..., 1, 3] = 1.0
    for column, power in ((4, r2), (5, r2**2), (8, r2**3)):
        d_lens[..., 0, column] = f[..., 0] * x * power
        d_lens[..., 1, column] = f[..., 1] * y * power
    d_lens[..., 0, 6], d_lens[..., 1, 6] = f[..., 0] * 2 * xy, f[..., 1] * (r2 + 2 * yy)
    d_lens[..., 0, 7], d_lens[..., 1, 7] = f[..., 0] * (r2 + 2 * xx), f[..., 1] * 2 * xy
    return pixel, d_point, d_lens


def moved(T: Poses, points: Floats) -> Floats:
    """(f, k, 3) points through (f, 4, 4) poses."""
    return np.asarray(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])


def turned(rows: Floats, M: Floats) -> Floats:
    """(f, k, 2, m) rows by each sighting's (f, n, m) matrix."""
    f, k = rows.shape[:2]
    return np.asarray((rows.reshape(f, 2 * k, -1) @ M).reshape(f, k, 2, -1), np.float64)


def by_pose(rows: Floats, points: Floats) -> Floats:
    """(f, k, 2, 6) change under ``exp(d)`` of points that move by v + w x p."""
    out = np.empty((*rows.shape[:3], 6))
    out[..., :3] = rows
    x, y, z = (points[:, :, None, i] for i in range(3))
    out[..., 3] = y * rows[..., 2] - z * rows[..., 1]
    out[..., 4] = z * rows[..., 0] - x * rows[..., 2]
    out[..., 5] = x * rows[..., 1] - y * rows[..., 0]
    return out
