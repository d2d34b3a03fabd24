"""Compiled ray casting of simple solids."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Pose

BOX, CYLINDER = 0, 1
TILE = 16
"""Pixels along the edge of a square that looks for its solids together."""


@njit(cache=True, nogil=True)
def cast(kinds: np.ndarray, sizes: Floats, T: Floats, rays: Floats, out: Floats32) -> None:
    """Write the depth [m] along each ray (z = 1) from the camera's origin; NaN where none hits.

    By squares of pixels: first the solids whose balls the square's cone of rays can meet.
    """
    height, width = out.shape
    count = kinds.shape[0]
    # Balls about the solids as the camera sees them.
    middle, ball = np.empty((count, 3)), np.empty(count)
    for k in range(count):
        for i in range(3):
            middle[k, i] = -(
                T[k, 0, i] * T[k, 0, 3] + T[k, 1, i] * T[k, 1, 3] + T[k, 2, i] * T[k, 2, 3]
            )
        if kinds[k] == CYLINDER:
            ball[k] = math.sqrt(sizes[k, 0] ** 2 + (0.5 * sizes[k, 1]) ** 2)
        else:
            ball[k] = 0.5 * math.sqrt((sizes[k] ** 2).sum())
    near = np.empty(count, np.int64)
    for v0 in range(0, height, TILE):
        for u0 in range(0, width, TILE):
            v1, u1 = min(v0 + TILE, height), min(u0 + TILE, width)
            a = rays[(v0 + v1) // 2, (u0 + u1) // 2]
            a = a / math.sqrt((a * a).sum())
            least = 1.0
            for v in (v0, v1 - 1):
                for u in (u0, u1 - 1):
                    b = rays[v, u]
                    least = min(least, (a * b).sum() / math.sqrt((b * b).sum()))
            opening = math.acos(min(least, 1.0)) + 1e-6
            found = 0
            for k in range(count):
                far = math.sqrt((middle[k] ** 2).sum())
                seen = far <= ball[k]
                if not seen:
                    away = math.acos(min(max((a * middle[k]).sum() / far, -1.0), 1.0))
                    seen = away <= opening + math.asin(ball[k] / far)
                if seen:
                    near[found] = k
                    found += 1
            for v in range(v0, v1):
                for u in range(u0, u1):
                    best = np.inf
                    for k in near[:found]:
                        best = meets(kinds[k], sizes[k], T[k], rays[v, u], best)
                    out[v, u] = best if best < np.inf else np.nan


@njit(cache=True, nogil=True)
def meets(kind: int, size: Floats, T: Pose, ray: Floats, best: float) -> float:
    """Depth at which a ray enters a solid, if that is less than ``best``, else ``best``."""
    p, d = np.empty(3), np.empty(3)
    for i in range(3):
        p[i] = T[i, 3]
        d[i] = T[i, 0] * ray[0] + T[i, 1] * ray[1] + T[i, 2] * ray[2]
    near, far = 0.0, best
    flat = 0
    if kind == CYLINDER:
        a = d[0] * d[0] + d[1] * d[1]
        b = p[0] * d[0] + p[1] * d[1]
        c = p[0] * p[0] + p[1] * p[1] - size[0] * size[0]
        square = b * b - a * c
        if a < 1e-15:
            if c > 0.0:
                return best
        elif square < 0.0:
            return best
        else:
            root = math.sqrt(square)
            near, far = max(near, (-b - root) / a), min(far, (-b + root) / a)
        flat = 2
    for i in range(flat, 3):
        half = 0.5 * (size[1] if kind == CYLINDER else size[i])
        if abs(d[i]) < 1e-15:
            if abs(p[i]) > half:
                return best
            continue
        t0, t1 = (-half - p[i]) / d[i], (half - p[i]) / d[i]
        near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near if 0.0 < near <= far and near < best else best
