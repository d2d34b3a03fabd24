"""Compiled search for the hazards that limit the arm's speed: nothing is sampled away.

Hazards are sorted into cubic blocks with tight bounds once a snapshot; a search skips the blocks
that hold nothing that matters, to within the rounding of float32 (a micrometre). Plain-numpy twins
are in the tests.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, Points
from armsight.motion.separation_kernels import Law, allowed_share

AMPLE = 2.0
"""A hazard that allows this many times the motion need not be found."""


class Blocks(NamedTuple):
    """Hazards sorted by block.

    Attributes:
        points: (h, 3) float32 centres in ``base`` [m], block after block.
        order: (h,) index of each in the snapshot's ``hazards``.
        first: (b + 1,) points ``first[k]:first[k + 1]`` are block k's.
        lower, upper: (3, b) float32 bounds of each block's points [m], one row an axis.
    """

    points: Floats32
    order: Ints
    first: Ints
    lower: Floats32
    upper: Floats32


@njit(cache=True, nogil=True)
def sort_into_blocks(hazards: Floats32, size: float) -> Blocks:
    """Sort (h, 3) hazards into cubes of edge ``size`` [m]."""
    h = hazards.shape[0]
    lo0 = lo1 = lo2 = np.float32(np.inf)
    hi0 = hi1 = hi2 = np.float32(-np.inf)
    for i in range(h):
        x, y, z = hazards[i, 0], hazards[i, 1], hazards[i, 2]
        lo0, lo1, lo2 = min(lo0, x), min(lo1, y), min(lo2, z)
        hi0, hi1, hi2 = max(hi0, x), max(hi1, y), max(hi2, z)
    if h == 0:
        return Blocks(
            np.empty((0, 3), np.float32),
            np.empty(0, np.int64),
            np.zeros(1, np.int64),
            np.empty((3, 0), np.float32),
            np.empty((3, 0), np.float32),
        )
    per = 1.0 / size
    nx = int((hi0 - lo0) * per) + 1
    ny = int((hi1 - lo1) * per) + 1
    nz = int((hi2 - lo2) * per) + 1
    cell = np.empty(h, np.int32)
    count = np.zeros(nx * ny * nz + 1, np.int64)
    for i in range(h):
        cx = int((hazards[i, 0] - lo0) * per)
        cy = int((hazards[i, 1] - lo1) * per)
        cz = int((hazards[i, 2] - lo2) * per)
        cell[i] = (cx * ny + cy) * nz + cz
        count[cell[i] + 1] += 1
    blocks = 0
    for c in range(nx * ny * nz):
        if count[c + 1] > 0:
            blocks += 1
        count[c + 1] += count[c]
    first = np.empty(blocks + 1, np.int64)
    k = 0
    for c in range(nx * ny * nz):
        if count[c + 1] > count[c]:
            first[k] = count[c]
            k += 1
    first[blocks] = h
    points = np.empty((h, 3), np.float32)
    order = np.empty(h, np.int64)
    for i in range(h):
        at = count[cell[i]]
        count[cell[i]] += 1
        order[at] = i
        points[at, 0] = hazards[i, 0]
        points[at, 1] = hazards[i, 1]
        points[at, 2] = hazards[i, 2]
    lower = np.empty((3, blocks), np.float32)
    upper = np.empty((3, blocks), np.float32)
    for k in range(blocks):
        lo0, lo1, lo2 = points[first[k], 0], points[first[k], 1], points[first[k], 2]
        hi0, hi1, hi2 = lo0, lo1, lo2
        for i in range(first[k] + 1, first[k + 1]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            lo0, lo1, lo2 = min(lo0, x), min(lo1, y), min(lo2, z)
            hi0, hi1, hi2 = max(hi0, x), max(hi1, y), max(hi2, z)
        lower[0, k], lower[1, k], lower[2, k] = lo0, lo1, lo2
        upper[0, k], upper[1, k], upper[2, k] = hi0, hi1, hi2
    return Blocks(points, order, first, lower, upper)


@njit(cache=True, nogil=True)
def _square_gaps(lower: Floats32, upper: Floats32, low: Any, high: Any, out: Floats32) -> None:
    """Add the squared gap between one interval and each of many [m^2]."""
    zero = np.float32(0.0)
    for k in range(out.shape[0]):
        below = lower[k] - high
        above = low - upper[k]
        gap = below if below > above else above
        gap = gap if gap > zero else zero
        out[k] += gap * gap


@njit(cache=True, nogil=True)
def scan(
    blocks: Blocks,
    center: Points,
    radius: Floats,
    velocity: Points,
    stopping: Floats,
    fastest: float,
    law: Law,
    horizon: float,
    distance: Floats,
    nearest: Ints,
    share: Floats,
    limiting: Ints,
) -> None:
    """Nearest hazard and allowed share of the motion for each of (m,) spheres.

    Args:
        blocks: the hazards.
        center: (m, 3) [m].
        radius: (m,) [m].
        velocity: (m, 3) of the whole motion [m/s].
        stopping: (m,) its stopping time [s].
        fastest: speed of the arm's fastest point [m/s].
        law: numbers of the law.
        horizon: farther hazards are of no interest unless they limit the motion [m].
        distance: (m,) out: to the nearest hazard [m], inf beyond the horizon.
        nearest: (m,) out: index into ``blocks.points``, -1 for none.
        share: (m,) out: allowed share of the motion; inf, or at least ``AMPLE``, if unlimited.
        limiting: (m,) out: index of the hazard that limits it, -1 for none.
    """
    count = blocks.lower.shape[1]
    bound = np.empty(count, np.float32)
    for i in range(center.shape[0]):
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        skin = radius[i] + law.hazard_radius
        speed = np.sqrt(vx * vx + vy * vy + vz * vz)
        best = horizon
        best_index = -1
        least = np.inf
        least_index = -1
        # Farther than this the whole motion is allowed, whatever its direction.
        cut = law.K + speed * (law.T_arm + 0.5 * stopping[i])
        cut += law.person * (law.T_person + stopping[i])
        if speed <= 0.0:
            cut = -np.inf
        bound[:] = np.float32(0.0)
        for axis in range(3):
            at = np.float32(center[i, axis])
            _square_gaps(blocks.lower[axis], blocks.upper[axis], at, at, bound)
        first = int(np.argmin(bound)) if count else -1
        # The nearest block comes first: what it holds rules out most of the others.
        for turn in range(-1, count):
            k = first if turn < 0 else turn
            if turn == first or k < 0:
                continue
            reach = max(cut, best) + skin
            if bound[k] > reach * reach:
                continue
            gap = np.sqrt(bound[k])
            near = gap - skin
            if near >= best:
                if near >= cut:
                    continue
                # No point of the block is closed in on faster than this.
                towards = max((blocks.lower[0, k] - x) * vx, (blocks.upper[0, k] - x) * vx)
                towards += max((blocks.lower[1, k] - y) * vy, (blocks.upper[1, k] - y) * vy)
                towards += max((blocks.lower[2, k] - z) * vz, (blocks.upper[2, k] - z) * vz)
                closing = speed
                if gap > 1e-4:
                    closing = min(max(towards, 0.0) / gap, speed)
                share_k = allowed_share(near, closing, fastest, stopping[i], law)
                if share_k >= min(least, AMPLE):
                    continue
            for p in range(blocks.first[k], blocks.first[k + 1]):
                ex = blocks.points[p, 0] - x
                ey = blocks.points[p, 1] - y
                ez = blocks.points[p, 2] - z
                away = np.sqrt(ex * ex + ey * ey + ez * ez)
                d = away - skin
                if d < best:
                    best = d
                    best_index = p
                if d < cut:
                    # At the very centre every direction closes in.
                    closing = speed
                    if away > 1e-9:
                        closing = (ex * vx + ey * vy + ez * vz) / away
                    s = allowed_share(d, closing, fastest, stopping[i], law)
                    if s < least:
                        least = s
                        least_index = p
        distance[i] = best if best_index >= 0 else np.inf
        nearest[i] = best_index
        share[i] = least
        limiting[i] = least_index


@njit(cache=True, nogil=True)
def in_reach(
    blocks: Blocks,
    places: Floats,
    radius: Floats,
    times: Floats,
    until: Floats,
    law: Law,
) -> int:
    """A sphere that somebody could reach before a stop has ended; -1 if there is none.

    That is a sphere i for which, at a look k before it stands and for a hazard h, the distance
    between them is less than what the person comes nearer until then and the margin:
    ``|h - x_ik| - r_i < v_h (T_r + t_k) + K``.

    Args:
        blocks: the hazards.
        places: (k, m, 3) where the spheres are in the course of the stop [m].
        radius: (m,) [m].
        times: (k,) of the looks, from the beginning of the stop [s].
        until: (m,) when each sphere stands [s]; one that does not move is not looked at.
        law: numbers of the law.
    """
    looks, count = places.shape[0], blocks.lower.shape[1]
    gaps = np.empty(count, np.float32)
    need = np.empty(looks)
    for i in range(places.shape[1]):
        if until[i] <= 0.0:
            continue
        reach = 0.0
        for k in range(looks):
            need[k] = radius[i] + law.hazard_radius + law.K
            need[k] += law.person * (law.T_person + min(times[k], until[i]))
            reach = max(reach, need[k])
        gaps[:] = np.float32(0.0)
        for axis in range(3):
            low, high = np.float32(places[:, i, axis].min()), np.float32(places[:, i, axis].max())
            _square_gaps(blocks.lower[axis], blocks.upper[axis], low, high, gaps)
        for b in range(count):
            if gaps[b] > reach * reach:
                continue
            for p in range(blocks.first[b], blocks.first[b + 1]):
                for k in range(looks):
                    ex = blocks.points[p, 0] - places[k, i, 0]
                    ey = blocks.points[p, 1] - places[k, i, 1]
                    ez = blocks.points[p, 2] - places[k, i, 2]
                    if ex * ex + ey * ey + ez * ez < need[k] * need[k]:
                        return i
    return -1
