"""Flat templates laid over a field of edge directions: scores, rolls, hill-climbing."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, SignedBytes, SignedShorts

UNIT = 1.0 / 127.0**2
BEHIND = 0.5
SLACK = 0.6
"""How far a few points may lag behind what is asked of all: over the root of their number."""


@njit(cache=True, nogil=True)
def squeeze(lean_x: float, lean_y: float) -> tuple[float, float, float, float, float]:
    """What a tilt makes of a circle (a symmetric matrix: xx, xy, yy), and where height goes."""
    tilt = np.sqrt(lean_x * lean_x + lean_y * lean_y)
    if tilt < 1e-9:
        return 1.0, 0.0, 1.0, 0.0, 0.0
    ax, ay = lean_x / tilt, lean_y / tilt
    k, up = np.cos(tilt), np.sin(tilt)
    return ax * ax + k * ay * ay, (1 - k) * ax * ay, ay * ay + k * ax * ax, -up * ay, up * ax


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _agreement(
    words: SignedShorts,
    size: tuple[int, int],
    points: Floats32,
    normals: Floats32,
    place: tuple[float, float, float],
    turn: tuple[float, float, float, float, float, float],
    other_way: float,
    start: int,
    stop: int,
) -> float:
    """How well some points of a template agree with a field; see :func:`template_score`.

    Nothing here branches and no step waits for the one before: the compiler takes 8 or 16 points
    at once.

    Args:
        words: (h w,) the field, a pixel's two bytes as one number, x the lower.
        size: h, w.
        points: of the template.
        normals: of the template.
        place: u, v, scale.
        turn: of a point to the picture, row by row: (2, 2) of x, y, then (2,) of z.
        other_way: see there.
        start: first point.
        stop: the point behind the last.
    """
    h, w = np.int32(size[0]), np.int32(size[1])
    u, v = np.float32(place[0] + 0.5), np.float32(place[1] + 0.5)
    scale, weak = np.float32(place[2]), np.float32(other_way)
    a, b, c, d = np.float32(turn[0]), np.float32(turn[1]), np.float32(turn[2]), np.float32(turn[3])
    e, f = np.float32(turn[4]), np.float32(turn[5])
    total, zero = np.float32(0.0), np.float32(0.0)
    for i in range(start, stop):
        px, py, pz = points[i, 0] * scale, points[i, 1] * scale, points[i, 2] * scale
        x, y = np.int32(u + a * px + b * py + e * pz), np.int32(v + c * px + d * py + f * pz)
        seen = (np.uint32(x) < np.uint32(w)) & (np.uint32(y) < np.uint32(h))
        # an index that cannot be negative is not tested for it
        word = words[np.uint32(y * w + x) if seen else np.uint32(0)]
        p, q = np.float32(np.int8(word)), np.float32(np.int8(word >> 8))
        nx = c * normals[i, 1] - d * normals[i, 0]
        ny = b * normals[i, 0] - a * normals[i, 1]
        dot = nx * p + ny * q
        full = np.float32(2.0) * dot * dot / (nx * nx + ny * ny) - p * p - q * q if seen else zero
        total += min(full, weak * full) if dot < zero else full
    return float(total)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _score(
    words: SignedShorts,
    size: tuple[int, int],
    points: Floats32,
    normals: Floats32,
    place: tuple[float, float, float],
    shape: tuple[float, float, float, float, float],
    turn: tuple[float, float],
    other_way: float,
    least: float,
) -> float:
    """See :func:`template_score`; shape: of a tilt; turn: cos, sin of roll."""
    s00, s01, s11, rise_x, rise_y = shape
    cr, sr = turn
    # template (y up) to picture (y down): a squeeze after a turn after a flip
    a, b, c, d = s00 * cr + s01 * sr, s00 * sr - s01 * cr, s01 * cr + s11 * sr, s01 * sr - s11 * cr
    whole = (a, b, c, d, rise_x, rise_y)
    total = np.float32(0.0)
    start, stop, n = 0, 16, len(points)
    while start < n:
        stop = min(stop, n)
        total += _agreement(words, size, points, normals, place, whole, other_way, start, stop)
        # points are scattered: what is seen of them tells of the rest, less surely at first
        if stop < n and least > 0.0 and total * UNIT / stop < least - SLACK / np.sqrt(stop):
            return -1.0
        start, stop = stop, 2 * stop
    return float(total * UNIT / n)


@njit(cache=True, nogil=True)
def template_score(
    field: SignedBytes,
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
        field: (h, w, 2) of :func:`armsight.charging.kernels.votes.edge_field`.
        points: (n, 3) template, y up, z towards who looks, in an order that tells early.
        normals: (n, 2) across its edges, towards the lighter side.
        guess: u, v [px], scale [px/m], tilt along x and y of the picture, roll [rad].
        other_way: what an edge is worth that is dark on the wrong side: light may come from any
            side.
        least: given up (the score is then -1) as soon as it is unlikely to be reached.
    """
    shape = squeeze(guess[3], guess[4])
    turn = (np.cos(guess[5]), np.sin(guess[5]))
    place = (guess[0], guess[1], guess[2])
    size = (field.shape[0], field.shape[1])
    words = field.view(np.int16).ravel()
    return _score(words, size, points, normals, place, shape, turn, other_way, least)


@njit(cache=True, nogil=True)
def best_rolls(
    field: SignedBytes,
    points: Floats32,
    normals: Floats32,
    guesses: Floats,
    rolls: Floats,
    other_way: float,
    least: float,
) -> Floats:
    """The best of some rolls of many guesses; see :func:`template_score`.

    Args:
        field: see there.
        points: see there.
        normals: see there.
        other_way: see there.
        guesses: (n, 6); their roll is set to the best.
        rolls: that are tried [rad].
        least: scores below it are not told apart from it, nor are those below a share
            (:data:`BEHIND`) of the best one before.

    Returns:
        (n,) scores.
    """
    scores = np.full(len(guesses), least)
    words, size = field.view(np.int16).ravel(), (field.shape[0], field.shape[1])
    leader = 0.0
    cos, sin = np.cos(rolls), np.sin(rolls)
    for i in range(len(guesses)):
        shape = squeeze(guesses[i, 3], guesses[i, 4])
        place = (guesses[i, 0], guesses[i, 1], guesses[i, 2])
        floor = max(least, BEHIND * leader)
        for k in range(len(rolls)):
            turn = (cos[k], sin[k])
            score = _score(words, size, points, normals, place, shape, turn, other_way, floor)
            if score > floor:
                floor = scores[i] = score
                guesses[i, 5] = rolls[k]
        leader = max(leader, scores[i])
    return scores


@njit(cache=True, nogil=True)
def climb(
    field: SignedBytes,
    points: Floats32,
    normals: Floats32,
    guess: Floats,
    reach: float,
    axes: int,
    other_way: float,
) -> tuple[float, Floats]:
    """Steps in place, size, tilt and roll as long as they help; see :func:`template_score`.

    Args:
        field: see there.
        points: see there.
        normals: see there.
        guess: start.
        reach: first step in place [px].
        axes: 6, or 5 to leave the roll alone.
        other_way: see there.
    """
    out = guess.copy()
    best = template_score(field, points, normals, out, other_way, 0.0)
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
                score = template_score(field, points, normals, trial, other_way, best)
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
def climb_all(
    field: SignedBytes,
    points: Floats32,
    normals: Floats32,
    guesses: Floats,
    reach: float,
    other_way: float,
) -> Floats:
    """(n, 7) scores and ends of :func:`climb` from many guesses, in all six axes."""
    out = np.empty((len(guesses), 7))
    for i in range(len(guesses)):
        score, end = climb(field, points, normals, guesses[i], reach, 6, other_way)
        out[i, 0], out[i, 1:] = score, end
    return out


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
