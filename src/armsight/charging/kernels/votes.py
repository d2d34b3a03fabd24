"""The votes of a picture's edges for the middles of the rings that they may belong to."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats32, Ints, Shorts


@njit(cache=True, nogil=True, fastmath=True)
def edge_field(gx: Floats32, gy: Floats32, soft: float) -> tuple[Floats32, Floats32]:
    """Gradients of a bounded size, g / sqrt(|g|^2 + soft^2).

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        soft: size of a gradient that counts half [levels/px].
    """
    h, w = gx.shape
    fx, fy = np.empty_like(gx), np.empty_like(gy)
    floor = np.float32(soft * soft)
    for y in range(h):
        for x in range(w):
            a, b = gx[y, x], gy[y, x]
            k = np.float32(1.0) / np.sqrt(a * a + b * b + floor)
            fx[y, x] = a * k
            fy[y, x] = b * k
    return fx, fy


@njit(cache=True, nogil=True, fastmath=True)
def vote_centers(
    gx: Floats32, gy: Floats32, least: float, tilts: Floats32, radii: Floats32
) -> Shorts:
    """Votes of edges for the middle of the rings that they may belong to.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        least: gradients below this do not vote; nor do those that are no crest of an edge.
        tilts: (classes, 2, 2) symmetric shapes of a circle of radius 1 that is seen tilted.
        radii: of rings [px].

    Returns:
        (classes, h // 2 + 1, w // 2 + 1) votes for cells of two by two pixels.
    """
    h, w = gx.shape
    classes = len(tilts)
    rows, columns = h // 2 + 1, w // 2 + 1
    votes = np.zeros((classes, rows, columns), np.uint16)
    floor = np.float32(least * least)
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            a, b = gx[y, x], gy[y, x]
            m = a * a + b * b
            if m < floor:
                continue
            if abs(b) < np.float32(0.414) * abs(a):  # a crest along the gradient
                dy, dx = 0, 1
            elif abs(a) < np.float32(0.414) * abs(b):
                dy, dx = 1, 0
            elif a * b > 0:
                dy, dx = 1, 1
            else:
                dy, dx = -1, 1
            p = gx[y - dy, x - dx] ** 2 + gy[y - dy, x - dx] ** 2
            q = gx[y + dy, x + dx] ** 2 + gy[y + dy, x + dx] ** 2
            if m < p or m <= q:
                continue
            for c in range(classes):
                # towards the middle: A m / |m| with m = A g, the circle's own normal
                u = tilts[c, 0, 0] * a + tilts[c, 0, 1] * b
                v = tilts[c, 1, 0] * a + tilts[c, 1, 1] * b
                k = np.float32(0.5) / np.sqrt(u * u + v * v)
                sx = k * (tilts[c, 0, 0] * u + tilts[c, 0, 1] * v)
                sy = k * (tilts[c, 1, 0] * u + tilts[c, 1, 1] * v)
                x0 = np.float32(0.5) * x + np.float32(0.25)
                y0 = np.float32(0.5) * y + np.float32(0.25)
                for r in radii:
                    for sign in (-1, 1):
                        i = int(x0 + sign * r * sx)
                        j = int(y0 + sign * r * sy)
                        if 0 <= i < columns and 0 <= j < rows:
                            votes[c, j, i] += 1
    return votes


@njit(cache=True, nogil=True)
def vote_crests(votes: Shorts, least: int) -> Ints:
    """Cells with more votes (of their own and their neighbours') than those around them.

    Args:
        votes: (classes, rows, columns) of :func:`vote_centers`.
        least: fewer votes are no crest.

    Returns:
        (n, 3) votes of the best class, column, row.
    """
    classes, rows, columns = votes.shape
    best = np.zeros((rows, columns), np.int32)
    line = np.zeros(columns, np.int32)
    for c in range(classes):
        for j in range(1, rows - 1):
            for i in range(columns):
                line[i] = votes[c, j - 1, i] + 2 * votes[c, j, i] + votes[c, j + 1, i]
            for i in range(1, columns - 1):
                k = line[i - 1] + 2 * line[i] + line[i + 1]
                best[j, i] = max(best[j, i], k)
    count = 0
    out = np.empty((rows * columns // 4 + 1, 3), np.int64)
    for j in range(1, rows - 1):
        for i in range(1, columns - 1):
            k = best[j, i]
            if k < least:
                continue
            crest = True
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    other = best[j + dj, i + di]
                    before = dj < 0 or (dj == 0 and di < 0)
                    if other > k or (other == k and before):
                        crest = False
            if crest and count < len(out):
                out[count, 0], out[count, 1], out[count, 2] = k, i, j
                count += 1
    return out[:count]
