"""Double rings about seeds: the first, coarse look at what a seed may be."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, SignedBytes

UNIT = np.float32(1.0 / 127.0**2)
SLACK = np.float32(1.5)
"""How far the first 8 or 16 points may lag behind what is asked of them."""


@njit(cache=True, nogil=True, fastmath=True)
def tilted_rings(leans: Floats, ring: Floats32) -> Floats32:
    """(t, p, 4) points and unit normals of a double ring seen tilted; see :func:`best_rings`."""
    out = np.empty((len(leans), len(ring), 4), np.float32)
    for t in range(len(leans)):
        tilt = np.sqrt(leans[t, 0] ** 2 + leans[t, 1] ** 2)
        x, y = (leans[t, 0] / tilt, leans[t, 1] / tilt) if tilt > 0 else (1.0, 0.0)
        k = np.cos(tilt)
        a, b, d = x * x + k * y * y, (1.0 - k) * x * y, y * y + k * x * x
        for p in range(len(ring)):
            out[t, p, 0] = a * ring[p, 0] + b * ring[p, 1]
            out[t, p, 1] = b * ring[p, 0] + d * ring[p, 1]
            m, n = np.cos(ring[p, 2]), np.sin(ring[p, 2])
            nx, ny = d * m - b * n, a * n - b * m
            size = np.sqrt(nx * nx + ny * ny)
            out[t, p, 2], out[t, p, 3] = nx / size, ny / size
    return out


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def best_rings(
    field: SignedBytes,
    seeds: Floats32,
    leans: Floats,
    radii: Floats,
    ring: Floats32,
    step: float,
    least: float,
) -> Floats:
    """Double rings of each size and tilt about each seed, where they fit best.

    A ring is as good as an inlet's mouth with its pedestal (light, dark, light towards the
    middle) or as a plug's sleeve with its bore (dark in the middle), whichever is better.

    Args:
        field: (h, w, 2) of :func:`armsight.charging.kernels.votes.edge_field`.
        seeds: (s, 2) [px].
        leans: (t, 2) tilts along x and y of the picture that are tried [rad].
        radii: (r,) of the outer ring [px].
        ring: (p, 3) points of a double ring of outer radius 1, and the angle of their normals;
            in an order that tells early.
        step: between the five places that are tried about a seed [px].
        least: scores below it are not told apart from 0.

    Returns:
        (s, r, t, 3) score, u, v [px].
    """
    flat = field.ravel()
    # an index that cannot be negative is not tested for it
    h, w, one = np.uint32(field.shape[0]), np.uint32(field.shape[1]), np.uintp(1)
    tilts, points = len(leans), len(ring)
    out = np.zeros((len(seeds), len(radii), tilts, 3))
    shape = tilted_rings(leans, ring)
    inside = ring[:, 0] * ring[:, 0] + ring[:, 1] * ring[:, 1] < 0.9
    weak = np.float32(0.2)
    for s in range(len(seeds)):
        for t in range(tilts):
            for i in range(len(radii)):
                r = np.float32(radii[i])
                best = np.float32(least)
                for o in range(5):
                    u = seeds[s, 0] + np.float32(0.5)
                    v = seeds[s, 1] + np.float32(0.5)
                    if o == 1 or o == 2:
                        u += np.float32(step * (2 * o - 3))
                    elif o > 2:
                        v += np.float32(step * (2 * o - 7))
                    total, dark = np.float32(0.0), np.float32(0.0)
                    p = 0
                    while p < points:
                        x = np.uint32(np.int32(u + r * shape[t, p, 0]))
                        y = np.uint32(np.int32(v + r * shape[t, p, 1]))
                        if x < w and y < h:
                            at = np.uintp(2) * (np.uintp(y) * np.uintp(w) + np.uintp(x))
                            a, b = np.float32(flat[at]), np.float32(flat[at + one])
                            dot = shape[t, p, 2] * a + shape[t, p, 3] * b
                            value = (np.float32(2.0) * dot * dot - a * a - b * b) * UNIT
                            inner = inside[p]
                            total += weak * value if value > 0 and (dot > 0) == inner else value
                            dark += weak * value if value > 0 and inner and dot < 0 else value
                        p += 1
                        # too little already: the rest will hardly make up for it
                        if (p == 8 or p == 16) and max(total, dark) < p * best - SLACK:
                            break
                    mean = max(total, dark) / p
                    if p == points and mean > best:
                        best = mean
                        out[s, i, t, 0] = mean
                        out[s, i, t, 1], out[s, i, t, 2] = u - 0.5, v - 0.5
                    if o == 0 and mean < 0.0:
                        break  # nothing like it at the seed itself: not beside it either
    return out
