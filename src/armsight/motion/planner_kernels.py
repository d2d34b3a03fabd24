"""Compiled RRT-Connect on proven edges.

It runs until a number of "looks" (body poses evaluated) is spent: the unit of work that makes a
plan depend on the seed alone, never on the speed of the machine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointPath, JointVector
from armsight.motion.body import Body
from armsight.motion.kernels import Obstacles, Scratch, edge_free

SOLVED, UNSOLVED, FULL = 1, 0, 2
SHORTEST = 0.02
"""Edges are tried no shorter than this [rad], unless the target is nearer."""


class Forest(NamedTuple):
    """Two trees, from the start (0) and from the goal (1); survives between calls.

    Attributes:
        q: (2, room, n); parent: (2, room); size: (2,) nodes so far.
        reach: (2, room) longest edge that a node tries next, see :func:`grow`.
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
    step: float,
    scratch: Scratch,
    new: JointVector,
) -> int:
    """Step from a node towards a target; index of the new node, or -1 when blocked.

    Every node has a step of its own, shorter each time it was blocked, so that trees get out of
    tight places, and doubled from node to node when it was not. It is tried in turn with ``step``,
    at random: long edges make short paths.
    """
    n = target.shape[0]
    d = 0.0
    for j in range(n):
        d += (target[j] - forest.q[side, near, j]) ** 2
    d = np.sqrt(d)
    own = step if uniform(forest.rng) < 0.75 else min(forest.reach[side, near], step)
    share = min(1.0, own / d) if d > 0.0 else 1.0
    for j in range(n):
        a = forest.q[side, near, j]
        new[j] = target[j] if share == 1.0 else a + share * (target[j] - a)
    if not edge_free(body, ob, forest.q[side, near], new, scratch):
        forest.reach[side, near] = max(0.7 * min(forest.reach[side, near], step), SHORTEST)
        return -1
    k = forest.size[side]
    forest.q[side, k] = new
    forest.parent[side, k] = near
    forest.reach[side, k] = np.inf if own == step else 2.0 * own
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
        a = grow(body, ob, forest, side, near, target, step, scratch, new)
        if a < 0:
            continue
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
