"""Compiled RRT-Connect on proven edges, and the anytime improvement of a path.

Both run until a number of "looks" (body poses evaluated) is spent: the unit of work that makes a
plan depend on the seed alone, never on the speed of the machine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointPath, JointVector
from armsight.motion.body import Body
from armsight.motion.cost_kernels import CostScratch, Danger, edge_cost
from armsight.motion.kernels import Obstacles, Scratch, edge_free

SOLVED, UNSOLVED, FULL = 1, 0, 2


class Forest(NamedTuple):
    """Two trees, from the start (0) and from the goal (1); survives between calls.

    Attributes:
        q: (2, room, n); parent: (2, room); size: (2,) nodes so far.
        reach: (2, room) sampling radius of a node that lately failed to grow, inf before.
        rng: (1,) uint64 state of the random numbers.
        box: (2, n) where samples are drawn.
        joint: (2,) nodes at which the trees meet.
    """

    q: Floats
    parent: Ints
    size: Ints
    reach: Floats
    rng: np.ndarray
    box: Floats
    joint: Ints


def make_forest(size: int, n: int) -> Forest:
    """Room for two trees of ``size`` nodes."""
    return Forest(
        np.zeros((2, size, n)),
        np.zeros((2, size), np.int64),
        np.zeros(2, np.int64),
        np.full((2, size), np.inf),
        np.zeros(1, np.uint64),
        np.zeros((2, n)),
        np.zeros(2, np.int64),
    )


@njit(cache=True, nogil=True)
def uniform(rng: np.ndarray) -> float:
    """Next random number in [0, 1) (splitmix64)."""
    rng[0] += np.uint64(0x9E3779B97F4A7C15)
    z = rng[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
def normal(rng: np.ndarray) -> float:
    """Next standard normal number (Box-Muller)."""
    u = 1.0 - uniform(rng)
    return np.sqrt(-2.0 * np.log(u)) * np.cos(2.0 * np.pi * uniform(rng))


@njit(cache=True, nogil=True)
def plant(forest: Forest, start: JointVector, goal: JointVector, seed: np.uint64) -> None:
    """Begin two new trees."""
    forest.q[0, 0] = start
    forest.q[1, 0] = goal
    forest.parent[0, 0] = -1
    forest.parent[1, 0] = -1
    forest.size[:] = 1
    forest.reach[0, 0] = np.inf
    forest.reach[1, 0] = np.inf
    forest.rng[0] = seed


@njit(cache=True, nogil=True)
def nearest(forest: Forest, side: int, q: JointVector) -> int:
    """Index of the tree's node nearest to q."""
    best, index = np.inf, 0
    n = q.shape[0]
    for k in range(forest.size[side]):
        d = 0.0
        for j in range(n):
            e = forest.q[side, k, j] - q[j]
            d += e * e
        if d < best:
            best, index = d, k
    return index


@njit(cache=True, nogil=True)
def grow(
    body: Body,
    ob: Obstacles,
    forest: Forest,
    side: int,
    near: int,
    target: JointVector,
    reach: float,
    scratch: Scratch,
    new: JointVector,
) -> int:
    """Step from a node towards a target; index of the new node, or -1 when blocked."""
    n = target.shape[0]
    d = 0.0
    for j in range(n):
        d += (target[j] - forest.q[side, near, j]) ** 2
    d = np.sqrt(d)
    share = min(1.0, reach / d) if d > 0.0 else 1.0
    for j in range(n):
        a = forest.q[side, near, j]
        new[j] = target[j] if share == 1.0 else a + share * (target[j] - a)
    if not edge_free(body, ob, forest.q[side, near], new, scratch):
        return -1
    k = forest.size[side]
    forest.q[side, k] = new
    forest.parent[side, k] = near
    forest.reach[side, k] = np.inf
    forest.size[side] = k + 1
    return k


@njit(cache=True, nogil=True)
def rrt_connect(
    body: Body, ob: Obstacles, forest: Forest, step: float, budget: int, scratch: Scratch
) -> int:
    """Grow the trees until they meet, or until ``budget`` more looks are spent."""
    n = body.lower.shape[0]
    size = forest.q.shape[1]
    target = np.empty(n)
    new = np.empty(n)
    end = scratch.looks[0] + budget
    side = 0
    while scratch.looks[0] < end:
        if forest.size[0] + 1 >= size or forest.size[1] + 1 >= size:
            return FULL
        # The smaller tree grows towards the sample, the other one then towards the new node.
        side = 0 if forest.size[0] <= forest.size[1] else 1
        for j in range(n):
            target[j] = forest.box[0, j] + uniform(forest.rng) * (
                forest.box[1, j] - forest.box[0, j]
            )
        near = nearest(forest, side, target)
        # Nodes that failed before are only grown towards samples close to them (dynamic domain).
        limit = forest.reach[side, near]
        if limit < np.inf:
            d = 0.0
            for j in range(n):
                d += (target[j] - forest.q[side, near, j]) ** 2
            if d > limit * limit:
                scratch.looks[0] += 1
                continue
        a = grow(body, ob, forest, side, near, target, step, scratch, new)
        if a < 0:
            if limit == np.inf:
                forest.reach[side, near] = 4.0 * step
            else:
                forest.reach[side, near] = max(0.9 * limit, 0.5 * step)
            continue
        if limit < np.inf:
            forest.reach[side, near] = limit * 1.1
        other = 1 - side
        target[:] = forest.q[side, a]
        near = nearest(forest, other, target)
        while True:
            if forest.size[other] + 1 >= size:
                return FULL
            b = grow(body, ob, forest, other, near, target, step, scratch, new)
            if b < 0:
                break
            reached = True
            for j in range(n):
                if forest.q[other, b, j] != target[j]:
                    reached = False
                    break
            if reached:
                forest.joint[side] = a
                forest.joint[other] = b
                return SOLVED
            near = b
    return UNSOLVED


@njit(cache=True, nogil=True)
def traced(forest: Forest) -> JointPath:
    """(k, n) path through the two trees from start to goal."""
    count = 0
    k = forest.joint[0]
    while k >= 0:
        count += 1
        k = forest.parent[0, k]
    k = forest.parent[1, forest.joint[1]]
    first = count
    while k >= 0:
        count += 1
        k = forest.parent[1, k]
    path = np.empty((count, forest.q.shape[2]))
    k = forest.joint[0]
    for i in range(first - 1, -1, -1):
        path[i] = forest.q[0, k]
        k = forest.parent[0, k]
    k = forest.parent[1, forest.joint[1]]
    for i in range(first, count):
        path[i] = forest.q[1, k]
        k = forest.parent[1, k]
    return path


@njit(cache=True, nogil=True)
def improve(
    body: Body,
    ob: Obstacles,
    danger: Danger,
    path: JointPath,
    seed: np.uint64,
    budget: int,
    scratch: Scratch,
    cost_scratch: CostScratch,
) -> JointPath:
    """A path of no greater cost: random shortcuts, corners moved, corners put in, all proven."""
    n = path.shape[1]
    room = 128
    q = np.empty((room, n))
    cost = np.empty(room)
    count = path.shape[0]
    if count > room or count < 2:
        return path
    for i in range(count):
        q[i] = path[i]
    for i in range(count - 1):
        cost[i] = edge_cost(body, danger, q[i], q[i + 1], cost_scratch)
    rng = np.empty(1, np.uint64)
    rng[0] = seed
    a, b = np.empty(n), np.empty(n)
    scale = 0.3
    end = scratch.looks[0] + cost_scratch.looks[0] + budget
    while scratch.looks[0] + cost_scratch.looks[0] < end:
        if count > 2 and uniform(rng) < 0.5:
            # Shortcut between two random places of the path.
            u, v = uniform(rng) * (count - 1), uniform(rng) * (count - 1)
            if u > v:
                u, v = v, u
            i, k = int(u), int(v)
            if i == k:
                continue
            fu, fv = u - i, v - k
            # Half of the time the ends snap to corners, so that corners can vanish.
            if uniform(rng) < 0.5:
                fu = 0.0
                fv = 0.0 if fv < 0.5 and k - i > 1 else 1.0
            for j in range(n):
                a[j] = q[i, j] + fu * (q[i + 1, j] - q[i, j])
                b[j] = q[k, j] + fv * (q[k + 1, j] - q[k, j])
            old = cost[i] * (1.0 - fu) + cost[k] * fv
            for s in range(i + 1, k):
                old += cost[s]
            new = edge_cost(body, danger, a, b, cost_scratch)
            if new >= old * (1.0 - 1e-4) or not edge_free(body, ob, a, b, scratch):
                continue
            head = edge_cost(body, danger, q[i], a, cost_scratch) if fu > 0.0 else 0.0
            tail = edge_cost(body, danger, b, q[k + 1], cost_scratch) if fv < 1.0 else 0.0
            old = 0.0
            for s in range(i, k + 1):
                old += cost[s]
            if head + new + tail >= old:
                continue
            insert = (1 if fu > 0.0 else 0) + (1 if fv < 1.0 else 0)
            shift = insert - (k - i)
            if count + shift > room:
                continue
            keep_q = q[k + 1 : count].copy()
            keep_cost = cost[k + 1 : count - 1].copy()
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
            for s in range(keep_cost.shape[0]):
                cost[at + s] = keep_cost[s]
            count = at + keep_q.shape[0]
            continue
        # Move a corner, or bend an edge at a new one.
        bend = count < 3 or (count < 24 and uniform(rng) < 0.3)
        if bend:
            i = int(uniform(rng) * (count - 1))
            f = 0.25 + 0.5 * uniform(rng)
            for j in range(n):
                a[j] = q[i, j] + f * (q[i + 1, j] - q[i, j])
            k = i + 1
            old = cost[i]
        else:
            i = 1 + int(uniform(rng) * (count - 2))
            a[:] = q[i]
            k = i + 1
            i -= 1
            old = cost[i] + cost[i + 1]
        if uniform(rng) < 0.5:
            j = int(uniform(rng) * n)
            a[j] += scale * normal(rng)
        else:
            for j in range(n):
                a[j] += scale * normal(rng) * 0.5
        for j in range(n):
            a[j] = min(max(a[j], body.lower[j]), body.upper[j])
        first = edge_cost(body, danger, q[i], a, cost_scratch)
        if first < old:
            second = edge_cost(body, danger, a, q[k], cost_scratch)
        if (
            first >= old
            or first + second >= old * (1.0 - 1e-4)
            or not edge_free(body, ob, q[i], a, scratch)
            or not edge_free(body, ob, a, q[k], scratch)
        ):
            scale = max(0.02, scale * 0.98)
            continue
        scale = min(0.6, scale * 1.3)
        if bend:
            for s in range(count, i + 1, -1):
                q[s] = q[s - 1]
            for s in range(count - 1, i, -1):
                cost[s] = cost[s - 1]
            count += 1
            q[i + 1] = a
        else:
            q[i + 1] = a
        cost[i] = first
        cost[i + 1] = second
    return q[:count].copy()
