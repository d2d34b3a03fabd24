"""Compiled inverse kinematics: damped least squares from many starts."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, JointPath, JointVector, Pose, Rotation3

TURN = 0.3
"""Metres that count as much as a radian of orientation error."""
FULL_TURN = 2.0 * np.pi
ITERATIONS = 120
"""Steps from one start; most starts that succeed need fewer than 30."""
POSITION, ORIENTATION = 1e-7, 1e-7
"""Solved below these errors [m], [rad]: far below any arm's repeatability."""


@njit(cache=True, nogil=True)
def _frames(
    rotation: Floats,
    offset: Floats,
    T_last_tcp: Pose,
    q: JointVector,
    axes: Floats,
    origins: Floats,
) -> tuple[Rotation3, Floats]:
    """Joint axes and origins in ``base``; returns the tip's rotation and position."""
    R, p = np.eye(3), np.zeros(3)
    for i in range(q.shape[0]):
        p = R @ offset[i] + p
        R = R @ rotation[i]
        s, c = np.sin(q[i]), np.cos(q[i])
        for r in range(3):
            a, b = R[r, 0], R[r, 1]
            R[r, 0], R[r, 1] = c * a + s * b, c * b - s * a
        axes[i] = R[:, 2]
        origins[i] = p
    return R @ np.ascontiguousarray(T_last_tcp[:3, :3]), R @ np.ascontiguousarray(
        T_last_tcp[:3, 3]
    ) + p


@njit(cache=True, nogil=True)
def _rotation_vector(R: Rotation3) -> Floats:
    """(3,) rotation vector of a matrix, sound near pi as well."""
    out = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = 0.5 * np.sqrt((out * out).sum())
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return out * (0.5 * angle / sine)
    if cosine > 0.0:
        return 0.5 * out
    # Half a turn: the axis is the column of R + 1 that is longest.
    k = 0
    for i in range(1, 3):
        if R[i, i] > R[k, k]:
            k = i
    axis = R[:, k].copy()
    axis[k] += 1.0
    return axis * (np.pi / np.sqrt((axis * axis).sum()))


@njit(cache=True, nogil=True)
def _error(
    R: Rotation3, p: Floats, R_goal: Rotation3, p_goal: Floats, out: Floats
) -> tuple[float, float]:
    """Write the weighted error (6,); returns errors of position [m] and orientation [rad]."""
    turn = _rotation_vector(R_goal @ R.T)
    far, off = 0.0, 0.0
    for r in range(3):
        out[r] = p_goal[r] - p[r]
        far += out[r] ** 2
        out[3 + r] = TURN * turn[r]
        off += turn[r] ** 2
    return np.sqrt(far), np.sqrt(off)


@njit(cache=True, nogil=True)
def descend(
    rotation: Floats,
    offset: Floats,
    T_last_tcp: Pose,
    lower: JointVector,
    upper: JointVector,
    T_goal: Pose,
    q: JointVector,
) -> bool:
    """Bring q to the goal within the limits (Levenberg-Marquardt, in place); whether it arrived."""
    n = q.shape[0]
    axes, origins = np.empty((n, 3)), np.empty((n, 3))
    R_goal = np.ascontiguousarray(T_goal[:3, :3])
    p_goal = np.ascontiguousarray(T_goal[:3, 3])
    error, trial_error = np.empty(6), np.empty(6)
    J = np.empty((6, n))
    R, p = _frames(rotation, offset, T_last_tcp, q, axes, origins)
    far, off = _error(R, p, R_goal, p_goal, error)
    cost = (error * error).sum()
    damping = 1e-3
    check = cost
    for iteration in range(ITERATIONS):
        if far < POSITION and off < ORIENTATION:
            return True
        if iteration % 15 == 14:
            # Too slow: another start is a better use of the time.
            if cost > 0.5 * check:
                return False
            check = cost
        for j in range(n):
            a, o = axes[j], origins[j]
            dx, dy, dz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
            J[0, j] = a[1] * dz - a[2] * dy
            J[1, j] = a[2] * dx - a[0] * dz
            J[2, j] = a[0] * dy - a[1] * dx
            for r in range(3):
                J[3 + r, j] = TURN * a[r]
        H = J.T @ J
        g = J.T @ error
        better = False
        for _ in range(8):
            A = H.copy()
            for j in range(n):
                A[j, j] += damping
                # A joint at its limit that is pushed outwards stays there.
                if (q[j] <= lower[j] and g[j] < 0.0) or (q[j] >= upper[j] and g[j] > 0.0):
                    A[j, j] += 1e9
            step = np.linalg.solve(A, g)
            size = np.abs(step).max()
            if size > 0.6:
                step *= 0.6 / size
            trial = np.minimum(np.maximum(q + step, lower), upper)
            R, p = _frames(rotation, offset, T_last_tcp, trial, axes, origins)
            trial_far, trial_off = _error(R, p, R_goal, p_goal, trial_error)
            trial_cost = (trial_error * trial_error).sum()
            if trial_cost < cost:
                better = True
                break
            damping *= 6.0
        if not better:
            return False
        damping = max(damping * 0.2, 1e-12)
        q[:] = trial
        error[:] = trial_error
        cost, far, off = trial_cost, trial_far, trial_off
    return far < POSITION and off < ORIENTATION


@njit(cache=True, nogil=True)
def solve(
    rotation: Floats,
    offset: Floats,
    T_last_tcp: Pose,
    lower: JointVector,
    upper: JointVector,
    T_goal: Pose,
    starts: JointPath,
    wanted: int,
) -> JointPath:
    """(k, n) different solutions, k <= wanted, from (s, n) starts tried in order.

    Whole turns of a joint make no other solution.
    """
    n = starts.shape[1]
    found = np.empty((wanted, n))
    count = 0
    for s in range(starts.shape[0]):
        q = starts[s].copy()
        if not descend(rotation, offset, T_last_tcp, lower, upper, T_goal, q):
            continue
        new = True
        for k in range(count):
            gap = 0.0
            for j in range(n):
                apart = found[k, j] - q[j]
                gap = max(gap, abs(apart - FULL_TURN * np.rint(apart / FULL_TURN)))
            if gap < 1e-3:
                new = False
                break
        if new:
            found[count] = q
            count += 1
            if count == wanted:
                break
    return found[:count].copy()
