"""The quick fit of a rigid model's edges to one picture, to compare many guesses."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32
from armsight.charging.kernels.edges import edge_search, project_lens


@njit(cache=True, nogil=True)
def fit_rigid(
    gx: Floats32,
    gy: Floats32,
    lens: Floats,
    points: Floats,
    normals: Floats,
    pose: Floats,
    reaches: Floats,
    least: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """A quick fit of a rigid model's edges to one picture, to compare many guesses.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        lens: see :func:`project_lens`.
        points: (n, 3) of the edges [m].
        normals: (n, 3) across them, in the plane z = const.
        pose: (4, 4) start.
        reaches: of the search, one an iteration [px].
        least: crests below this are none [levels/px].

    Returns:
        (4, 4) pose; (n,) distances of the edges at the end [px], NaN for none; (n,) gradients
        along the normals there [levels/px]; (6, 6) information of the pose for edges that are
        known to 1 px, as a twist in the model's frame.
    """
    n = len(points)
    T = pose.copy()
    pixels, across = np.empty((n, 2)), np.empty((n, 2))
    rows = np.empty((n, 6))
    H = np.eye(6)
    d, rise = np.full(n, np.nan), np.zeros(n)
    for i in range(len(reaches) + 1):
        R = np.ascontiguousarray(T[:3, :3])
        for k in range(n):
            p, m = points[k], normals[k]
            q = R @ p + T[:3, 3]
            if q[2] < 0.02:
                pixels[k, 0], pixels[k, 1] = -1e6, -1e6
                continue
            e = R @ np.array([-m[1], m[0], 0.0])
            h = 1e-4
            u, v = project_lens(lens, q[0], q[1], q[2])
            u2, v2 = project_lens(lens, q[0] + h * e[0], q[1] + h * e[1], q[2] + h * e[2])
            du, dv = u2 - u, v2 - v
            norm = np.sqrt(du * du + dv * dv) + 1e-12
            nx, ny = dv / norm, -du / norm
            pixels[k, 0], pixels[k, 1] = u, v
            across[k, 0], across[k, 1] = nx, ny
            a, b = nx * lens[0] / q[2], ny * lens[1] / q[2]
            in_lens = np.array([a, b, -(a * q[0] + b * q[1]) / q[2]])
            g = in_lens @ R
            rows[k, 0], rows[k, 1], rows[k, 2] = g[0], g[1], g[2]
            rows[k, 3] = p[1] * g[2] - p[2] * g[1]
            rows[k, 4] = p[2] * g[0] - p[0] * g[2]
            rows[k, 5] = p[0] * g[1] - p[1] * g[0]
        final = i == len(reaches)
        reach = 2.5 if final else reaches[i]
        d, rise = edge_search(gx, gy, pixels, across, reach, max(0.6 * reach, 1.0), least, 0.92)
        if final:
            break
        size = np.abs(d)
        seen = size[np.isfinite(size)]
        if len(seen) < 12:
            d[:] = np.nan
            break
        spread = max(1.4826 * np.median(seen), 0.4)
        H[:], g6 = 0.0, np.zeros(6)
        for k in range(n):
            if np.isfinite(d[k]):
                w = 1.0 / max(size[k] / (1.5 * spread), 1.0)
                if size[k] > 4.0 * spread:
                    w *= 0.1
                for a6 in range(6):
                    g6[a6] += w * rows[k, a6] * d[k]
                    for b6 in range(a6 + 1):
                        H[a6, b6] += w * rows[k, a6] * rows[k, b6]
        for a6 in range(6):
            H[a6, a6] *= 1.0 + 1e-6
            for b6 in range(a6):
                H[b6, a6] = H[a6, b6]
        x = np.linalg.solve(H + 1e-9 * np.eye(6), g6)
        far = max(np.sqrt((x[:3] ** 2).sum()) / 0.05, np.sqrt((x[3:] ** 2).sum()) / 0.25)
        if far > 1.0:
            x /= far
        angle = np.sqrt((x[3:] ** 2).sum())
        K = np.array([[0.0, -x[5], x[4]], [x[5], 0.0, -x[3]], [-x[4], x[3], 0.0]])
        s, c = (
            (1.0, 0.5)
            if angle < 1e-6
            else (
                np.sin(angle) / angle,
                (1.0 - np.cos(angle)) / angle**2,
            )
        )
        T[:3, 3] += np.ascontiguousarray(T[:3, :3]) @ x[:3]
        T[:3, :3] = np.ascontiguousarray(T[:3, :3]) @ (np.eye(3) + s * K + c * (K @ K))
    return T, d, rise, H
