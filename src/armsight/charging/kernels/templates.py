"""Flat templates laid over a field of edge directions: scores, rolls, hill-climbing."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints


@njit(cache=True, nogil=True)
def flat_affine(guess: Floats) -> tuple[float, float, float, float]:
    """Template (y up) to picture (y down) of a guess, a squeeze after a turn after a flip.

    Args:
        guess: u, v [px], scale [px/m], tilt along x and y of the picture, roll [rad].
    """
    scale, lean_x, lean_y, roll = guess[2], guess[3], guess[4], guess[5]
    tilt = np.sqrt(lean_x * lean_x + lean_y * lean_y)
    ax, ay = (lean_x / tilt, lean_y / tilt) if tilt > 1e-9 else (1.0, 0.0)
    k = np.cos(tilt)
    s00, s01, s11 = ax * ax + k * ay * ay, (1 - k) * ax * ay, ay * ay + k * ax * ax
    cr, sr = np.cos(roll), np.sin(roll)
    return (
        scale * (s00 * cr + s01 * sr),
        scale * (s00 * sr - s01 * cr),
        scale * (s01 * cr + s11 * sr),
        scale * (s01 * sr - s11 * cr),
    )


@njit(cache=True, nogil=True)
def flat_rise(guess: Floats) -> tuple[float, float]:
    """Where a point above the template's plane is seen, per metre of height [px/m]."""
    tilt = np.sqrt(guess[3] * guess[3] + guess[4] * guess[4])
    if tilt < 1e-9:
        return 0.0, 0.0
    k = guess[2] * np.sin(tilt) / tilt
    return -k * guess[4], k * guess[3]


@njit(cache=True, nogil=True, fastmath=True)
def template_score(
    fx: Floats32,
    fy: Floats32,
    points: Floats32,
    normals: Floats32,
    guess: Floats,
    other_way: float,
    least: float,
) -> float:
    """How well a flat template's edges agree with a picture's, at most 1.

    The mean over its points of cos 2a, a the angle between the template's normal and the
    picture's gradient, weak gradients counting less: as Steger's similarity measure (C. Steger,
    "Occlusion, clutter, and illumination invariant object recognition", 2002), but an edge that
    lies across counts against it, and one that is dark on the wrong side counts ``other_way``.

    Args:
        fx: (h, w) of :func:`armsight.charging.kernels.votes.edge_field`, along x.
        fy: (h, w) along y.
        points: (n, 3) template, y up, z towards who looks, in an order that tells early.
        normals: (n, 2) across its edges, towards the lighter side.
        guess: see :func:`flat_affine`.
        other_way: what an edge is worth that is dark on the wrong side: light may come from any
            side.
        least: given up (the score is then -1) as soon as it is unlikely to be reached.
    """
    h, w = fx.shape
    a, b, c, d = flat_affine(guess)
    e, f = flat_rise(guess)
    u, v = guess[0] + 0.5, guess[1] + 0.5
    facing = a * d - b * c  # the template's y is up, the picture's down
    total = 0.0
    n = len(points)
    check = 16
    for i in range(n):
        x = int(u + a * points[i, 0] + b * points[i, 1] + e * points[i, 2])
        y = int(v + c * points[i, 0] + d * points[i, 1] + f * points[i, 2])
        if 0 <= x < w and 0 <= y < h:
            nx = d * normals[i, 0] - c * normals[i, 1]
            ny = a * normals[i, 1] - b * normals[i, 0]
            p, q = fx[y, x], fy[y, x]
            dot = nx * p + ny * q
            value = 2.0 * dot * dot / (nx * nx + ny * ny) - p * p - q * q
            if value > 0.0 and dot * facing < 0.0:
                value *= other_way
            total += value
        if i + 1 == check and least > 0.0:
            # points are scattered: what is seen of them tells of the rest, less surely at first
            if total / check < least - 0.9 / np.sqrt(check):
                return -1.0
            check *= 2
    return total / n


@njit(cache=True, nogil=True)
def best_rolls(
    fx: Floats32,
    fy: Floats32,
    points: Floats32,
    normals: Floats32,
    guesses: Floats,
    rolls: Floats,
    other_way: float,
    least: float,
) -> Floats:
    """The best of some rolls of many guesses; see :func:`template_score`.

    Args:
        fx: see there.
        fy: see there.
        points: see there.
        normals: see there.
        other_way: see there.
        guesses: (n, 6); their roll is set to the best.
        rolls: that are tried [rad].
        least: scores below it are not told apart from it.

    Returns:
        (n,) scores.
    """
    scores = np.full(len(guesses), least)
    trial = np.empty(6)
    for i in range(len(guesses)):
        trial[:] = guesses[i]
        for k in range(len(rolls)):
            trial[5] = rolls[k]
            score = template_score(fx, fy, points, normals, trial, other_way, scores[i])
            if score > scores[i]:
                scores[i] = score
                guesses[i, 5] = rolls[k]
    return scores


@njit(cache=True, nogil=True)
def climb(
    fx: Floats32,
    fy: Floats32,
    points: Floats32,
    normals: Floats32,
    guess: Floats,
    reach: float,
    axes: int,
    other_way: float,
) -> tuple[float, Floats]:
    """Steps in place, size, tilt and roll as long as they help; see :func:`template_score`.

    Args:
        fx: see there.
        fy: see there.
        points: see there.
        normals: see there.
        guess: start.
        reach: first step in place [px].
        axes: 6, or 5 to leave the roll alone.
        other_way: see there.
    """
    out = guess.copy()
    best = template_score(fx, fy, points, normals, out, other_way, 0.0)
    extent = 0.0
    for i in range(len(points)):
        extent = max(extent, abs(points[i, 0]), abs(points[i, 1]))
    turn = reach / (extent * guess[2])
    steps = np.array([reach, reach, turn * guess[2], 2.0 * turn, 2.0 * turn, turn])
    last = np.zeros(6)
    trial = out.copy()
    for _ in range(12):
        moved = False
        for axis in range(axes):
            first = 1.0 if last[axis] >= 0 else -1.0
            for sign in (first, -first):
                trial[:] = out
                trial[axis] += sign * steps[axis]
                if trial[3] ** 2 + trial[4] ** 2 > 1.0:
                    continue
                score = template_score(fx, fy, points, normals, trial, other_way, 0.0)
                if score > best:
                    best, moved = score, True
                    out[:] = trial
                    last[axis] = sign
                    break
        if not moved:
            if steps[0] < 0.6:
                break
            steps *= 0.5
    return best, out


@njit(cache=True, nogil=True)
def distinct(rows: Floats, most: int, crowd: int) -> Ints:
    """Indices of the first rings that differ in place, size or tilt.

    Args:
        rows: (n, 6) score, u, v, tilt along x and y, radius; the best first.
        most: how many are enough.
        crowd: most of them at one place.
    """
    kept = np.empty(most, np.int64)
    count = 0
    for i in range(len(rows)):
        same, here = False, 0
        for k in range(count):
            a, b = rows[i], rows[kept[k]]
            near = 0.12 * b[5]
            if abs(a[1] - b[1]) < near and abs(a[2] - b[2]) < near:
                here += 1
                alike = abs(a[3] - b[3]) < 0.15 and abs(a[4] - b[4]) < 0.15
                if (alike and abs(a[5] - b[5]) < 0.08 * b[5]) or here == crowd:
                    same = True
                    break
        if not same:
            kept[count] = i
            count += 1
            if count == most:
                break
    return kept[:count]
