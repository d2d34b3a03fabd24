"""Double rings about seeds: the first, coarse look at what a seed may be."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32


@njit(cache=True, nogil=True, fastmath=True)
def best_rings(
    fx: Floats32,
    fy: Floats32,
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
        fx: (h, w) of :func:`armsight.charging.kernels.votes.edge_field`, along x.
        fy: (h, w) along y.
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
    h, w = fx.shape
    tilts, points = len(leans), len(ring)
    out = np.zeros((len(seeds), len(radii), tilts, 3))
    at = np.empty((tilts, points, 2), np.float32)
    across = np.empty((tilts, points, 2), np.float32)
    for t in range(tilts):
        tilt = np.sqrt(leans[t, 0] ** 2 + leans[t, 1] ** 2)
        x, y = (leans[t, 0] / tilt, leans[t, 1] / tilt) if tilt > 0 else (1.0, 0.0)
        k = np.cos(tilt)
        a, b, d = x * x + k * y * y, (1.0 - k) * x * y, y * y + k * x * x
        for p in range(points):
            at[t, p, 0] = a * ring[p, 0] + b * ring[p, 1]
            at[t, p, 1] = b * ring[p, 0] + d * ring[p, 1]
            m, n = np.cos(ring[p, 2]), np.sin(ring[p, 2])
            nx, ny = d * m - b * n, a * n - b * m
            size = np.sqrt(nx * nx + ny * ny)
            across[t, p, 0], across[t, p, 1] = nx / size, ny / size
    inside = ring[:, 0] * ring[:, 0] + ring[:, 1] * ring[:, 1] < 0.9
    for s in range(len(seeds)):
        for i in range(len(radii)):
            r = np.float32(radii[i])
            for t in range(tilts):
                best = least
                here = np.float32(0.0)
                for o in range(5):
                    if o > 0 and here < 0.0:
                        break  # nothing like it at the seed itself: not beside it either
                    u = seeds[s, 0] + np.float32(0.5)
                    v = seeds[s, 1] + np.float32(0.5)
                    if o == 1 or o == 2:
                        u += np.float32(step * (2 * o - 3))
                    elif o > 2:
                        v += np.float32(step * (2 * o - 7))
                    total, dark, hopeless = np.float32(0.0), np.float32(0.0), False
                    for p in range(points):
                        x = int(u + r * at[t, p, 0])
                        y = int(v + r * at[t, p, 1])
                        if 0 <= x < w and 0 <= y < h:
                            a, b = fx[y, x], fy[y, x]
                            dot = across[t, p, 0] * a + across[t, p, 1] * b
                            value = np.float32(2.0) * dot * dot - a * a - b * b
                            inner = inside[p]
                            if value > 0 and (dot > 0) == inner:
                                total += np.float32(0.2) * value
                            else:
                                total += value
                            if value > 0 and inner and dot < 0:
                                dark += np.float32(0.2) * value
                            else:
                                dark += value
                        # too little already: the rest will hardly make up for it
                        if (p == 9 or p == 19) and max(total, dark) < (p + 1) * best - 1.7:
                            hopeless = True
                            break
                    if o == 0:
                        here = max(total, dark) / (p + 1)
                    if not hopeless and max(total, dark) > best * points:
                        best = float(max(total, dark)) / points
                        out[s, i, t, 0] = best
                        out[s, i, t, 1], out[s, i, t, 2] = u - 0.5, v - 0.5
    return out
