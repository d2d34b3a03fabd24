"""Double rings about seeds: the first, coarse look at what a seed may be."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, SignedBytes, SignedShorts

UNIT = np.float32(1.0 / 127.0**2)
SLACK = np.float32(1.5)
"""How far the first 8 or 16 points may lag behind what is asked of them."""


@njit(cache=True, nogil=True, fastmath=True)
def tilted_rings(leans: Floats, ring: Floats32) -> Floats32:
    """(t, 4, p) points (x, y) and unit normals (x, y) of a double ring seen tilted.

    What belongs to one point lies apart, so that many points are worked on at once.
    """
    out = np.empty((len(leans), 4, len(ring)), np.float32)
    for t in range(len(leans)):
        tilt = np.sqrt(leans[t, 0] ** 2 + leans[t, 1] ** 2)
        x, y = (leans[t, 0] / tilt, leans[t, 1] / tilt) if tilt > 0 else (1.0, 0.0)
        k = np.cos(tilt)
        a, b, d = x * x + k * y * y, (1.0 - k) * x * y, y * y + k * x * x
        for p in range(len(ring)):
            out[t, 0, p] = a * ring[p, 0] + b * ring[p, 1]
            out[t, 1, p] = b * ring[p, 0] + d * ring[p, 1]
            m, n = np.cos(ring[p, 2]), np.sin(ring[p, 2])
            nx, ny = d * m - b * n, a * n - b * m
            size = np.sqrt(nx * nx + ny * ny)
            out[t, 2, p], out[t, 3, p] = nx / size, ny / size
    return out


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _agreement(
    words: SignedShorts,
    size: tuple[int, int],
    shape: Floats32,
    inside: Floats32,
    place: tuple[float, float, float],
    start: int,
    stop: int,
) -> tuple[float, float]:
    """How well some points of a double ring agree with a field: as an inlet's, as a plug's.

    Nothing here branches and no step waits for the one before: the compiler takes 8 or 16 points
    at once, at a third of the time.

    Args:
        words: (h w,) the field, a pixel's two bytes as one number, x the lower.
        size: h, w.
        shape: (4, p) of one tilt; see :func:`tilted_rings`.
        inside: (p,) 1 for points of the inner ring, 0 of the outer one.
        place: u, v [px] + 0.5, radius [px].
        start: first point.
        stop: the point behind the last.
    """
    h, w = np.int32(size[0]), np.int32(size[1])
    u, v, r = np.float32(place[0]), np.float32(place[1]), np.float32(place[2])
    weak, zero, one, two = np.float32(0.2), np.float32(0.0), np.float32(1.0), np.float32(2.0)
    inlet, plug = zero, zero
    for p in range(start, stop):
        x, y = np.int32(u + r * shape[0, p]), np.int32(v + r * shape[1, p])
        seen = (np.uint32(x) < np.uint32(w)) & (np.uint32(y) < np.uint32(h))
        # an index that cannot be negative is not tested for it
        word = words[np.uint32(y * w + x) if seen else np.uint32(0)]
        a, b = np.float32(np.int8(word)), np.float32(np.int8(word >> 8))
        dot = shape[2, p] * a + shape[3, p] * b
        full = two * dot * dot - a * a - b * b if seen else zero
        less = min(full, weak * full)  # the gradient points the other way: agreeing counts little
        inlet += less if dot * (two * inside[p] - one) > zero else full
        plug += less if dot * inside[p] < zero else full
    return float(inlet * UNIT), float(plug * UNIT)


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
    words, size = field.view(np.int16).ravel(), (field.shape[0], field.shape[1])
    tilts, points = len(leans), len(ring)
    out = np.zeros((len(seeds), len(radii), tilts, 3))
    shape = tilted_rings(leans, ring)
    inner = ring[:, 0] * ring[:, 0] + ring[:, 1] * ring[:, 1] < 0.9
    inside = inner.astype(np.float32)
    for s in range(len(seeds)):
        for t in range(tilts):
            for i in range(len(radii)):
                best = least
                for o in range(5):
                    u = seeds[s, 0] + np.float32(0.5)
                    v = seeds[s, 1] + np.float32(0.5)
                    if o == 1 or o == 2:
                        u += np.float32(step * (2 * o - 3))
                    elif o > 2:
                        v += np.float32(step * (2 * o - 7))
                    place = (u, v, radii[i])
                    inlet, plug = 0.0, 0.0
                    p = 0
                    for stop in (8, 16, points):
                        more = _agreement(words, size, shape[t], inside, place, p, stop)
                        inlet, plug, p = inlet + more[0], plug + more[1], stop
                        # too little already: the rest will hardly make up for it
                        if p < points and max(inlet, plug) < p * best - SLACK:
                            break
                    mean = max(inlet, plug) / p
                    if p == points and mean > best:
                        best = mean
                        out[s, i, t, 0] = mean
                        out[s, i, t, 1], out[s, i, t, 2] = u - 0.5, v - 0.5
                    if o == 0 and mean < 0.0:
                        break  # nothing like it at the seed itself: not beside it either
    return out
