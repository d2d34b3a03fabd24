"""Kernels of the cover of points by capsules: choice, taking out, free movement of the axes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats, Ints, Points


@njit(cache=True, nogil=True)
def axis_distances(points: Points, start: Points, end: Points) -> Floats:
    """(k, n) distance of each of (n, 3) points to each of k segments [m]."""
    out = np.empty((start.shape[0], points.shape[0]))
    for i in range(start.shape[0]):
        ux, uy, uz = end[i, 0] - start[i, 0], end[i, 1] - start[i, 1], end[i, 2] - start[i, 2]
        length2 = ux * ux + uy * uy + uz * uz
        for j in range(points.shape[0]):
            x = points[j, 0] - start[i, 0]
            y = points[j, 1] - start[i, 1]
            z = points[j, 2] - start[i, 2]
            if length2 > 0.0:
                t = (x * ux + y * uy + z * uz) / length2
                t = min(1.0, max(0.0, t))
                x -= t * ux
                y -= t * uy
                z -= t * uz
            out[i, j] = np.sqrt(x * x + y * y + z * z)
    return out


@njit(cache=True, nogil=True)
def search_cover(
    covers: Bytes,
    covers_t: Bytes,
    spills: Bytes,
    weight: Floats,
    reachable: NDArray[np.bool_],
    middle: Points,
    price: float,
    seeds: Floats,
) -> Ints:
    """Indices of the chosen candidates."""
    k, n = covers.shape
    m = weight.shape[0]
    count = np.zeros(n, np.int32)
    for j in range(n):
        if not reachable[j]:
            count[j] = 1_000_000
    spilled = np.zeros(m, np.int32)
    used = np.zeros(k, np.bool_)
    chosen = _fill(covers, covers_t, spills, weight, count, spilled, used, price)
    best = _cost(chosen, spilled, weight, price)
    for r in range(seeds.shape[0]):
        size = len(chosen)
        if size < 2:
            break
        center = chosen[min(size - 1, int(seeds[r, 0] * size))]
        take = min(size, 2 + int(seeds[r, 1] * 4))
        gap = np.empty(size)
        for i in range(size):
            d = middle[chosen[i]] - middle[center]
            gap[i] = np.sqrt(np.sum(d * d))
        out = [chosen[i] for i in np.argsort(gap)[:take]]
        count_before, spilled_before = count.copy(), spilled.copy()
        for i in out:
            _put(covers[i], count, -1)
            _put(spills[i], spilled, -1)
        kept = [i for i in chosen if i not in out]
        used[:] = False
        used[np.array(out)] = seeds[r, 1] > 0.5  # half of the time force something new
        new = _fill(covers, covers_t, spills, weight, count, spilled, used, price)
        trial = kept + new
        _drop_idle(trial, covers, spills, count, spilled)
        cost = _cost(trial, spilled, weight, price)
        if cost < best - 1e-15:
            chosen, best = trial, cost
        else:
            count[:] = count_before
            spilled[:] = spilled_before
    return np.array(chosen)


@njit(cache=True, nogil=True)
def _put(row: Bytes, count: NDArray[np.int32], step: int) -> None:
    for j in range(row.shape[0]):
        if row[j]:
            count[j] += step


@njit(cache=True, nogil=True)
def _cost(chosen: list[int], spilled: NDArray[np.int32], weight: Floats, price: float) -> float:
    total = price * len(chosen)
    for j in range(weight.shape[0]):
        if spilled[j] > 0:
            total += weight[j]
    return total


@njit(cache=True, nogil=True)
def _fill(
    covers: Bytes,
    covers_t: Bytes,
    spills: Bytes,
    weight: Floats,
    count: NDArray[np.int32],
    spilled: NDArray[np.int32],
    used: NDArray[np.bool_],
    price: float,
) -> list[int]:
    """Greedy: cover what is open, always by the candidate with most gain for its cost."""
    k = covers.shape[0]
    gain = np.zeros(k, np.int64)
    for j in range(count.shape[0]):
        if count[j] == 0:
            for i in range(k):
                gain[i] += covers_t[j, i]
    cost = np.full(k, -1.0)
    chosen = [0 for _ in range(0)]
    while True:
        pick, merit = -1, 0.0
        for i in range(k):
            if gain[i] <= 0 or used[i]:
                continue
            if gain[i] / price <= merit:
                continue
            if cost[i] < 0.0:
                total = price
                for j in range(weight.shape[0]):
                    if spills[i, j] and spilled[j] == 0:
                        total += weight[j]
                cost[i] = total
            if gain[i] / cost[i] > merit:
                merit = gain[i] / cost[i]
                pick = i
        if pick < 0:
            if (count == 0).any() and used.any():
                used[:] = False
                continue
            return chosen
        chosen.append(pick)
        for j in range(count.shape[0]):
            if covers[pick, j]:
                if count[j] == 0:
                    for i in range(k):
                        gain[i] -= covers_t[j, i]
                count[j] += 1
        _put(spills[pick], spilled, 1)
        cost[:] = -1.0


@njit(cache=True, nogil=True)
def _drop_idle(
    chosen: list[int],
    covers: Bytes,
    spills: Bytes,
    count: NDArray[np.int32],
    spilled: NDArray[np.int32],
) -> None:
    """Take out candidates whose points others cover as well."""
    for at in range(len(chosen) - 1, -1, -1):
        i = chosen[at]
        idle = True
        for j in range(count.shape[0]):
            if covers[i, j] and count[j] == 1:
                idle = False
                break
        if idle:
            _put(covers[i], count, -1)
            _put(spills[i], spilled, -1)
            chosen.pop(at)


@njit(cache=True, nogil=True)
def refine_cover(
    points: Points,
    near: Points,
    weight: Floats,
    start: Points,
    end: Points,
    radius: Floats,
    price: float,
    sweeps: int,
) -> tuple[Points, Points, Floats, float]:
    """Axes, radii [m] and overshoot of a cover whose axes have moved and whose idle ones went."""
    start, end, radius = start.copy(), end.copy(), radius.copy()
    _take_over(points, start, end, radius)
    everyone = np.arange(radius.shape[0])
    cost = _relax(points, near, weight, start, end, radius, everyone, sweeps)
    while price > 0.0 and radius.shape[0] > 1:
        best, best_cost = -1, cost + price
        best_start, best_end, best_radius = start, end, radius
        for k in range(radius.shape[0]):
            s, e, r = _without(start, k), _without(end, k), radius[np.arange(len(radius)) != k]
            _take_over(points, s, e, r)
            middle = 0.5 * (start[k] + end[k])
            gap = np.empty(r.shape[0])
            for i in range(r.shape[0]):
                d = 0.5 * (s[i] + e[i]) - middle
                gap[i] = np.sqrt(np.sum(d * d))
            close = np.argsort(gap)[:5]
            c = _relax(points, near, weight, s, e, r, close, 3)
            if c < best_cost:
                best, best_cost = k, c
                best_start, best_end, best_radius = s, e, r
        if best < 0:
            break
        start, end, radius = best_start, best_end, best_radius
        cost = _relax(points, near, weight, start, end, radius, np.arange(len(radius)), 4)
    cost = _relax(points, near, weight, start, end, radius, np.arange(len(radius)), sweeps)
    return start, end, radius, cost


@njit(cache=True, nogil=True)
def _without(rows: Points, k: int) -> Points:
    out = np.empty((rows.shape[0] - 1, 3))
    out[:k] = rows[:k]
    out[k:] = rows[k + 1 :]
    return out


@njit(cache=True, nogil=True)
def _take_over(points: Points, start: Points, end: Points, radius: Floats) -> None:
    """Grow radii until all points are covered, each point by the capsule that it is nearest to."""
    distance = axis_distances(points, start, end)
    for j in range(points.shape[0]):
        best, lack = 0, np.inf
        for i in range(radius.shape[0]):
            if distance[i, j] - radius[i] < lack:
                best, lack = i, distance[i, j] - radius[i]
        if lack > 0.0:
            radius[best] = distance[best, j]


@njit(cache=True, nogil=True)
def _relax(
    points: Points,
    near: Points,
    weight: Floats,
    start: Points,
    end: Points,
    radius: Floats,
    which: Ints,
    sweeps: int,
) -> float:
    """Move the capsules named, in place, to less overshoot; returns the overshoot of all."""
    distance = axis_distances(points, start, end)
    spread = axis_distances(near, start, end)
    step = np.full(radius.shape[0], 0.008)
    for _ in range(sweeps):
        moved = False
        for k in which:
            if step[k] < 0.0006:
                continue
            own = _exclusive(distance, radius, k, 1e-9)
            free = _exclusive(spread, radius, k, 0.0)
            free = free[spread[k][free] < radius[k] + 0.04]
            if own.shape[0] == 0:
                radius[k] = 0.0
                continue
            mine, theirs, theirs_weight = points[own], near[free], weight[free]
            ball = np.array_equal(start[k], end[k])
            a, b = start[k].copy(), end[k].copy()
            best_r, best = _price_of(mine, theirs, theirs_weight, a, b)
            best_a, best_b = a.copy(), b.copy()
            for part in range(1 if ball else 3):
                for x in range(-1, 2):
                    for y in range(-1, 2):
                        for z in range(-1, 2):
                            move = step[k] * np.array([float(x), float(y), float(z)])
                            ta = a + move if part != 2 or ball else a
                            tb = b + move if part != 1 or ball else b
                            r, c = _price_of(mine, theirs, theirs_weight, ta, tb)
                            if c < best * (1.0 - 1e-6):
                                best, best_r = c, r
                                best_a, best_b = ta.copy(), tb.copy()
            if np.array_equal(best_a, a) and np.array_equal(best_b, b):
                step[k] *= 0.5
            else:
                start[k], end[k] = best_a, best_b
                distance[k] = axis_distances(points, start[k : k + 1], end[k : k + 1])[0]
                spread[k] = axis_distances(near, start[k : k + 1], end[k : k + 1])[0]
                moved = True
            radius[k] = best_r
        if not moved and step[which].max() < 0.0006:
            break
    total = 0.0
    for j in range(near.shape[0]):
        for i in range(radius.shape[0]):
            if spread[i, j] <= radius[i]:
                total += weight[j]
                break
    return total


@njit(cache=True, nogil=True)
def _exclusive(distance: Floats, radius: Floats, k: int, slack: float) -> Ints:
    """Which points no capsule but k covers."""
    out = np.empty(distance.shape[1], np.int64)
    count = 0
    for j in range(distance.shape[1]):
        alone = True
        for i in range(distance.shape[0]):
            if i != k and distance[i, j] <= radius[i] + slack:
                alone = False
                break
        if alone:
            out[count] = j
            count += 1
    return out[:count].copy()


@njit(cache=True, nogil=True)
def _price_of(
    mine: Points, theirs: Points, weight: Floats, a: Points, b: Points
) -> tuple[float, float]:
    """Radius that an axis needs for its points, and the overshoot that it then has."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length2 = ux * ux + uy * uy + uz * uz
    worst = 0.0
    for j in range(mine.shape[0]):
        x, y, z = mine[j, 0] - a[0], mine[j, 1] - a[1], mine[j, 2] - a[2]
        if length2 > 0.0:
            t = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / length2))
            x, y, z = x - t * ux, y - t * uy, z - t * uz
        d = x * x + y * y + z * z
        worst = max(worst, d)
    total = 0.0
    for j in range(theirs.shape[0]):
        x, y, z = theirs[j, 0] - a[0], theirs[j, 1] - a[1], theirs[j, 2] - a[2]
        if length2 > 0.0:
            t = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / length2))
            x, y, z = x - t * ux, y - t * uy, z - t * uz
        if x * x + y * y + z * z <= worst:
            total += weight[j]
    r = np.sqrt(worst)
    # A whiff of volume, so that idle size shrinks too.
    return r, total + 1e-6 * r * r * (r + np.sqrt(length2))
