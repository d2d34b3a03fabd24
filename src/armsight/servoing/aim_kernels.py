"""Compiled: joints that bring a tool to an aim (V's eq. 2); a plain twin is in the tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointVector, Points, Pose, Poses, Vector3
from armsight.robots.kernels import chain_poses_into, jacobian


class Chain(NamedTuple):
    """An arm: its chain, its tool, its joints' limits and the parts of it that may rise.

    Attributes:
        T_link_joint: (n, 4, 4); axis: (n, 3); T_last_tcp: the tool in the last link.
        lower, upper: (n,) [rad].
        link: (m,) that carries each part; center: (m, 3) in it, radius: (m,) [m].
    """

    T_link_joint: Poses
    axis: Points
    T_last_tcp: Pose
    lower: JointVector
    upper: JointVector
    link: Ints
    center: Points
    radius: Floats


class Goal(NamedTuple):
    """Where the tool should be and point.

    Attributes:
        position: (3,) [m]; axis: (3,) unit, of its z; down: (3,) of its y, as far as z lets it.
    """

    position: Vector3
    axis: Vector3
    down: Vector3


class Cost(NamedTuple):
    """What counts how much.

    Attributes:
        position: of the tip; axis: of its direction [m/rad]; roll: about it [m/rad].
        posture: (n,) of the joints' way [m/rad].
        up: (3,) unit; height: above which no part rises, along it [m]; inf for none.
        hard: of what is too high.
        near: the direction counts less and less from so far below that height on [m] ...
        least: ... down to this share of it.
    """

    position: float
    axis: float
    roll: float
    posture: Floats
    up: Vector3
    height: float
    hard: float
    near: float
    least: float


@njit(cache=True, nogil=True)
def _cross(a: Vector3, b: Vector3) -> Vector3:
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@njit(cache=True, nogil=True)
def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def tip_error(T: Pose, goal: Goal) -> Floats:
    """(6,) error of a tip (4, 4) [m], and of its axis and roll [rad], in ``base``."""
    x, y, z = T[:3, 0].copy(), T[:3, 1].copy(), T[:3, 2].copy()
    turn = _cross(z, goal.axis)
    sine, cosine = np.sqrt(_dot(turn, turn)), _dot(z, goal.axis)
    if cosine < 0.0 and sine < 1e-6:
        turn, sine = x, 1.0
    angle = np.arctan2(sine, cosine) / max(sine, 1e-9)
    down = goal.down - z * _dot(z, goal.down)
    length = np.sqrt(_dot(down, down))
    roll = 0.0
    if length > 0.1:
        down = down / length
        roll = np.arctan2(_dot(_cross(y, down), z), _dot(y, down))
    out = np.empty(6)
    for k in range(3):
        out[k] = goal.position[k] - T[k, 3]
        out[3 + k] = turn[k] * angle + roll * z[k]
    return out


@njit(cache=True, nogil=True)
def highest(poses: Poses, chain: Chain, up: Vector3) -> tuple[float, JointVector]:
    """Height of the highest part along ``up`` [m], and its (n,) derivative [m/rad]."""
    best, which, at = -np.inf, -1, np.zeros(3)
    for i in range(chain.link.shape[0]):
        T = poses[chain.link[i]]
        p = T[:3, 3].copy()
        for k in range(3):
            for c in range(3):
                p[k] += T[k, c] * chain.center[i, c]
        height = _dot(p, up) + chain.radius[i]
        if height > best:
            best, which, at = height, i, p
    rise = np.zeros(chain.axis.shape[0])
    if which >= 0:
        J = jacobian(poses, chain.axis, chain.link[which], at)
        for j in range(rise.shape[0]):
            rise[j] = J[0, j] * up[0] + J[1, j] * up[1] + J[2, j] * up[2]
    return best, rise


@njit(cache=True, nogil=True)
def aimed_joints(
    chain: Chain, cost: Cost, goal: Goal, start: JointVector, rounds: int, most: float
) -> JointVector:
    """(n,) joints that minimise the cost near a start, by damped Gauss-Newton [rad].

    Args:
        chain: the arm.
        cost: what counts.
        goal: of its tool.
        start: (n,) [rad].
        rounds: of Gauss-Newton.
        most: a round turns no joint by more than this [rad].
    """
    n = start.shape[0]
    q = start.copy()
    poses = np.empty((n + 1, 4, 4))
    for _ in range(rounds):
        chain_poses_into(q, chain.T_link_joint, chain.axis, poses)
        T = np.dot(poses[n], chain.T_last_tcp)
        z = T[:3, 2].copy()
        over, rise = -np.inf, np.zeros(n)
        share = 1.0
        if cost.height < np.inf:
            top, rise = highest(poses, chain, cost.up)
            over = top - cost.height
            share = 1.0 - (1.0 - cost.least) * min(max(1.0 + over / cost.near, 0.0), 1.0)
        e, J = tip_error(T, goal), jacobian(poses, chain.axis, n, T[:3, 3].copy())
        W = np.zeros((6, 6))
        for a in range(3):
            W[a, a] = cost.position
            for b in range(3):
                along = z[a] * z[b]
                W[3 + a, 3 + b] = share * cost.axis * ((a == b) - along) + cost.roll * along
        A = np.dot(W, J)
        M = np.dot(A.T, A)
        for j in range(n):
            M[j, j] += cost.posture[j] ** 2
        g = np.dot(A.T, np.dot(W, e))
        step = np.linalg.solve(M, g)
        if over + np.dot(rise, step) > 0.0:
            weight = cost.hard**2
            M += weight * np.outer(rise, rise)
            step = np.linalg.solve(M, g - weight * over * rise)
        scale = min(1.0, most / max(np.abs(step).max(), 1e-9))
        q = np.minimum(np.maximum(q + scale * step, chain.lower + 0.01), chain.upper - 0.01)
    return q
