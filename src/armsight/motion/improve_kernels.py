"""Compiled anytime improvement of a path: cheaper by C_traj, every edge proven.

Moves are tried at random and kept when they cost less:

* shortcut: a straight line between two places of the path;
* drop: a corner is left out, even for a trifle more cost, as fewer corners are driven faster;
* bend: a new corner in the middle of an edge;
* sway: neighbouring corners are moved together, most in the middle; after a success the same sway
  is tried again, longer.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, JointPath, JointVector
from armsight.motion.body import Body
from armsight.motion.cost_kernels import COARSE, Danger, edge_cost
from armsight.motion.kernels import Obstacles, Scratch, edge_free
from armsight.motion.planner_kernels import normal, uniform

ROOM = 64
"""Most corners that a path may have to be improved."""
BENT = 8
"""A path is not bent at new corners beyond this number."""
TRIFLE = 1.002
"""Dropping a corner may cost this factor."""
GAIN = 1e-4
"""A move must save at least this share of what it replaces."""


@njit(cache=True, nogil=True)
def improve(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    path: JointPath,
    seed: np.uint64,
    budget: int,
    scratch: Scratch,
) -> JointPath:
    """A cheaper path by at most ``budget`` looks, with the same ends."""
    n, count = path.shape[1], path.shape[0]
    if count > ROOM or count < 2:
        return path
    q, cost = np.empty((ROOM, n)), np.zeros(ROOM)
    q[:count] = path
    for i in range(count - 1):
        cost[i] = edge_cost(body, danger, q[i], q[i + 1], scratch, COARSE)
    rng = np.empty(1, np.uint64)
    rng[0] = seed
    new_q, new_cost = np.empty((ROOM, n)), np.zeros(ROOM)
    way, weight = np.zeros(n), np.zeros(n)
    # Joints that carry more of the arm are swayed more: the wrist hardly changes the cost.
    for j in range(n):
        weight[j] = body.lever[:, j].mean()
    weight = np.sqrt(np.maximum(weight / weight.max(), 0.01))
    scale = 0.25
    end = scratch.looks[0] + budget
    while scratch.looks[0] < end:
        move = uniform(rng)
        if count > 2 and move < 0.2:
            count = _shortcut(body, ob, danger, q, cost, count, rng, scratch)
        elif count > 2 and move < 0.3:
            count = _drop(body, ob, danger, q, cost, count, rng, scratch)
        elif count < 3 or (count < BENT and move < 0.4):
            count = _bend(body, ob, danger, q, cost, count, scale, rng, scratch)
        else:
            length = scale * np.exp(0.7 * normal(rng))
            for j in range(n):
                way[j] = weight[j] * normal(rng)
            if uniform(rng) < 0.4:
                one = int(uniform(rng) * n)
                for j in range(n):
                    if j != one:
                        way[j] = 0.0
            size = np.sqrt((way * way).sum())
            middle = 1.0 + uniform(rng) * (count - 3)
            width = 0.51 + uniform(rng) * (count - 2)
            tries = 0
            while tries < 4 and _sway(
                body,
                ob,
                danger,
                q,
                cost,
                count,
                way,
                length / size,
                middle,
                width,
                new_q,
                new_cost,
                scratch,
            ):
                length *= 1.5
                tries += 1
            scale = min(0.6, scale * 1.2) if tries > 0 else max(0.02, scale * 0.97)
    return q[:count].copy()


@njit(cache=True, nogil=True)
def _sway(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    q: JointPath,
    cost: Floats,
    count: int,
    way: JointVector,
    length: float,
    middle: float,
    width: float,
    new_q: JointPath,
    new_cost: Floats,
    scratch: Scratch,
) -> bool:
    """Move the corners within ``width`` of ``middle``; whether it was kept."""
    n = q.shape[1]
    first = max(1, int(np.ceil(middle - width)))
    last = min(count - 2, int(np.floor(middle + width)))
    if first > last:
        return False
    old = 0.0
    for i in range(first - 1, last + 1):
        old += cost[i]
    new_q[first - 1] = q[first - 1]
    new_q[last + 1] = q[last + 1]
    for i in range(first, last + 1):
        share = length * (1.0 - abs(i - middle) / width)
        for j in range(n):
            new_q[i, j] = min(max(q[i, j] + share * way[j], body.lower[j]), body.upper[j])
    new = 0.0
    for i in range(first - 1, last + 1):
        new_cost[i] = edge_cost(body, danger, new_q[i], new_q[i + 1], scratch, COARSE)
        new += new_cost[i]
        if new >= old * (1.0 - GAIN):
            return False
    for i in range(first - 1, last + 1):
        if not edge_free(body, ob, new_q[i], new_q[i + 1], scratch):
            return False
    for i in range(first - 1, last + 1):
        cost[i] = new_cost[i]
    q[first : last + 1] = new_q[first : last + 1]
    return True


@njit(cache=True, nogil=True)
def _bend(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    q: JointPath,
    cost: Floats,
    count: int,
    scale: float,
    rng: np.ndarray,
    scratch: Scratch,
) -> int:
    """Put a corner into an edge, beside the middle of it; the new number of corners."""
    n = q.shape[1]
    i = int(uniform(rng) * (count - 1))
    f = 0.3 + 0.4 * uniform(rng)
    a = np.empty(n)
    for j in range(n):
        x = q[i, j] + f * (q[i + 1, j] - q[i, j]) + scale * normal(rng)
        a[j] = min(max(x, body.lower[j]), body.upper[j])
    first = edge_cost(body, danger, q[i], a, scratch, COARSE)
    if first >= cost[i]:
        return count
    second = edge_cost(body, danger, a, q[i + 1], scratch, COARSE)
    # A corner has to be worth it.
    if first + second >= cost[i] * (1.0 - 10.0 * GAIN):
        return count
    if not (edge_free(body, ob, q[i], a, scratch) and edge_free(body, ob, a, q[i + 1], scratch)):
        return count
    for s in range(count, i + 1, -1):
        q[s] = q[s - 1]
        cost[s] = cost[s - 1]
    q[i + 1] = a
    cost[i] = first
    cost[i + 1] = second
    return count + 1


@njit(cache=True, nogil=True)
def _drop(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    q: JointPath,
    cost: Floats,
    count: int,
    rng: np.ndarray,
    scratch: Scratch,
) -> int:
    """Leave a corner out; the new number of corners."""
    i = 1 + int(uniform(rng) * (count - 2))
    new = edge_cost(body, danger, q[i - 1], q[i + 1], scratch, COARSE)
    if new > (cost[i - 1] + cost[i]) * TRIFLE:
        return count
    if not edge_free(body, ob, q[i - 1], q[i + 1], scratch):
        return count
    for s in range(i, count - 1):
        q[s] = q[s + 1]
        cost[s] = cost[s + 1]
    cost[i - 1] = new
    return count - 1


@njit(cache=True, nogil=True)
def _shortcut(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    q: JointPath,
    cost: Floats,
    count: int,
    rng: np.ndarray,
    scratch: Scratch,
) -> int:
    """Join two places of the path by a straight line; the new number of corners."""
    n = q.shape[1]
    u, v = uniform(rng) * (count - 1), uniform(rng) * (count - 1)
    if u > v:
        u, v = v, u
    i, k = int(u), int(v)
    if i == k:
        return count
    fu, fv = u - i, v - k
    if uniform(rng) < 0.5:
        # From corner to corner, so that corners vanish.
        fu = 0.0
        fv = 1.0
    a, b = np.empty(n), np.empty(n)
    for j in range(n):
        a[j] = q[i, j] + fu * (q[i + 1, j] - q[i, j])
        b[j] = q[k, j] + fv * (q[k + 1, j] - q[k, j])
    old = 0.0
    for s in range(i, k + 1):
        old += cost[s]
    shift = (1 if fu > 0.0 else 0) + (1 if fv < 1.0 else 0) - (k - i)
    if count + shift > ROOM:
        return count
    new = edge_cost(body, danger, a, b, scratch, COARSE)
    if new >= old:
        return count
    head = edge_cost(body, danger, q[i], a, scratch, COARSE) if fu > 0.0 else 0.0
    tail = edge_cost(body, danger, b, q[k + 1], scratch, COARSE) if fv < 1.0 else 0.0
    if head + new + tail >= old * (1.0 - GAIN) or not edge_free(body, ob, a, b, scratch):
        return count
    keep_q = q[k + 1 : count].copy()
    keep_cost = cost[k + 1 : count].copy()
    at = i
    if fu > 0.0:
        cost[at] = head
        at += 1
        q[at] = a
    cost[at] = new
    at += 1
    if fv < 1.0:
        q[at] = b
        cost[at] = tail
        at += 1
    for s in range(keep_q.shape[0]):
        q[at + s] = keep_q[s]
        cost[at + s] = keep_cost[s]
    return at + keep_q.shape[0]
