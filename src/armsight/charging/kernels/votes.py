"""The votes of a picture's edges for the middles of the rings that they may belong to."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints32, Shorts, SignedBytes, SignedShorts

DIRECTIONS = 128
"""Of edges that vote."""


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def edge_field(
    gx: Floats32 | SignedShorts, gy: Floats32 | SignedShorts, soft: float
) -> SignedBytes:
    """Gradients of a bounded size, 127 g / sqrt(|g|^2 + soft^2).

    In bytes, x and y side by side: templates are looked up in it all over the picture, and what
    they wait for is memory.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        soft: size of a gradient that counts half [levels/px].

    Returns:
        (h, w, 2) along x and y, in 127ths.
    """
    h, w = gx.shape
    out = np.empty((h, w, 2), np.int8)
    floor, whole = np.float32(soft * soft), np.float32(127.0)
    for y in range(h):
        for x in range(w):
            a, b = np.float32(gx[y, x]), np.float32(gy[y, x])
            k = whole / np.sqrt(a * a + b * b + floor)
            out[y, x, 0] = np.int8(np.rint(a * k))
            out[y, x, 1] = np.int8(np.rint(b * k))
    return out


@njit(cache=True, nogil=True, fastmath=True)
def vote_centers(
    gx: Floats32 | SignedShorts,
    gy: Floats32 | SignedShorts,
    least: float,
    tilts: Floats32,
    radii: Floats32,
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
    margin = int(np.ceil(0.5 * radii.max())) + 2
    votes = np.zeros((classes, rows + 2 * margin, columns + 2 * margin), np.uint16)
    flat, stride = votes.ravel(), columns + 2 * margin
    cells = _vote_cells(_vote_steps(tilts, radii), stride, stride * (rows + 2 * margin))
    floor, turns = np.float32(least * least), np.float32(DIRECTIONS / (2 * np.pi))
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            a, b = np.float32(gx[y, x]), np.float32(gy[y, x])
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
            a0, b0 = np.float32(gx[y - dy, x - dx]), np.float32(gy[y - dy, x - dx])
            a1, b1 = np.float32(gx[y + dy, x + dx]), np.float32(gy[y + dy, x + dx])
            if m < a0 * a0 + b0 * b0 or m <= a1 * a1 + b1 * b1:
                continue
            way = int(np.arctan2(b, a) * turns + np.float32(DIRECTIONS + 0.5)) % DIRECTIONS
            own = cells[way, 2 * (y & 1) + (x & 1)]
            here = (y // 2 + margin) * stride + x // 2 + margin
            for k in range(len(own)):
                flat[np.uintp(here + own[k])] += 1
    return votes[:, margin : margin + rows, margin : margin + columns]


@njit(cache=True, nogil=True)
def _vote_steps(tilts: Floats32, radii: Floats32) -> Floats32:
    """(directions, classes, 2 radii, 2) from an edge to the middles it votes for [cells]."""
    out = np.empty((DIRECTIONS, len(tilts), 2 * len(radii), 2), np.float32)
    for d in range(DIRECTIONS):
        angle = 2 * np.pi * d / DIRECTIONS
        a, b = np.cos(angle), np.sin(angle)
        for c in range(len(tilts)):
            # towards the middle: A m / |m| with m = A g, the circle's own normal
            u = tilts[c, 0, 0] * a + tilts[c, 0, 1] * b
            v = tilts[c, 1, 0] * a + tilts[c, 1, 1] * b
            k = 0.5 / np.sqrt(u * u + v * v)
            for i in range(len(radii)):
                for side in range(2):
                    r = k * radii[i] * (2 * side - 1)
                    out[d, c, 2 * i + side, 0] = r * (tilts[c, 0, 0] * u + tilts[c, 0, 1] * v)
                    out[d, c, 2 * i + side, 1] = r * (tilts[c, 1, 0] * u + tilts[c, 1, 1] * v)
    return out


@njit(cache=True, nogil=True)
def _vote_cells(steps: Floats32, stride: int, plane: int) -> Ints32:
    """(directions, 4, n) from an edge's cell to those it votes for, in elements of the votes.

    An edge lies at a quarter or at three quarters of its cell: which one along y and x is the
    second index (yx: 0 0, 0 1, 1 0, 1 1). So nothing is left to round when votes are cast.

    Args:
        steps: of :func:`_vote_steps`.
        stride: cells in a row.
        plane: cells in a class.
    """
    directions, classes, each, _ = steps.shape
    out = np.empty((directions, 4, classes * each), np.int32)
    for d in range(directions):
        for c in range(classes):
            for i in range(each):
                for place in range(4):
                    # a step of 2 that was rounded to 1.9999998 is one of 2
                    x = np.floor(steps[d, c, i, 0] + 0.25 + 0.5 * (place & 1) + 1e-6)
                    y = np.floor(steps[d, c, i, 1] + 0.25 + 0.5 * (place >> 1) + 1e-6)
                    out[d, place, c * each + i] = c * plane + int(y) * stride + int(x)
    return out


@njit(cache=True, nogil=True)
def vote_crests(votes: Shorts, least: int) -> Floats:
    """Cells with more votes (of their own and their neighbours') than those around them.

    Args:
        votes: (classes, rows, columns) of :func:`vote_centers`.
        least: fewer votes are no crest.

    Returns:
        (n, 3) votes of the best class, column, row, to a part of a cell.
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
    out = np.empty((rows * columns // 4 + 1, 3))
    for j in range(1, rows - 1):
        for i in range(1, columns - 1):
            k = best[j, i]
            if k < least:
                continue
            crest, lowest = True, k
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    other = best[j + dj, i + di]
                    before = dj < 0 or (dj == 0 and di < 0)
                    lowest = min(lowest, other)
                    if other > k or (other == k and before):
                        crest = False
            if crest and count < len(out):
                # the middle of the votes about it: a cell is coarse
                total, x, y = 0.0, 0.0, 0.0
                for dj in range(-1, 2):
                    for di in range(-1, 2):
                        more = best[j + dj, i + di] - lowest
                        total, x, y = total + more, x + di * more, y + dj * more
                total = max(total, 1.0)
                out[count, 0], out[count, 1], out[count, 2] = k, i + x / total, j + y / total
                count += 1
    return out[:count]
