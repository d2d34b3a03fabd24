"""Kinematics of many configurations at once: flange, body Jacobian, reaching a flange pose."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, JointPath, Mask, Poses
from armsight.calibration import se3
from armsight.robots.robot import Robot


def turns(axis: Floats, angle: Floats) -> Poses:
    """(v, 4, 4) rotations about one (3,) axis by (v,) angles [rad] (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T = np.zeros((len(angle), 4, 4))
    T[:, :3, :3] = (
        np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)
    )
    T[:, 3, 3] = 1.0
    return T


def joint_frames(
    robot: Robot, joints: JointPath, origins: Floats | None = None
) -> tuple[Poses, Poses, Poses]:
    """Frames along the chain, all in ``base``.

    Args:
        robot: the arm.
        joints: (v, n) [rad].
        origins: (n, 3) joint origins in their parents instead of the nominal ones [m].

    Returns:
        (n, v, 4, 4) parent link of each joint, (n, v, 4, 4) joint before it turns,
        (v, 4, 4) flange.
    """
    v = len(joints)
    parents, frames = np.empty((2, robot.n, v, 4, 4))
    T = np.broadcast_to(np.eye(4), (v, 4, 4)).copy()
    for i in range(robot.n):
        parents[i] = T
        joint = robot.T_link_joint[i]
        if origins is not None:
            joint = joint.copy()
            joint[:3, 3] = origins[i]
        T = T @ joint
        frames[i] = T
        T = T @ turns(robot.axis[i], joints[:, i])
    return parents, frames, T @ robot.T_last_flange


def body_screws(robot: Robot, frames: Poses, flange: Poses) -> Floats:
    """(v, 6, n) body Jacobian of the flange: translation [m/rad], then rotation, flange axes."""
    R_t = np.swapaxes(flange[:, :3, :3], 1, 2)
    out = np.empty((len(flange), 6, robot.n))
    for i in range(robot.n):
        w = frames[i][:, :3, :3] @ robot.axis[i]
        out[:, :3, i] = np.einsum(
            "vij,vj->vi", R_t, np.cross(w, flange[:, :3, 3] - frames[i][:, :3, 3])
        )
        out[:, 3:, i] = np.einsum("vij,vj->vi", R_t, w)
    return out


def flange_poses(robot: Robot, joints: JointPath) -> Poses:
    """(v, 4, 4) ``T_base_flange`` of (v, n) configurations [rad]."""
    return joint_frames(robot, np.asarray(joints, float))[2]


def reach(
    robot: Robot, targets: Poses, starts: JointPath, rounds: int = 40
) -> tuple[JointPath, Mask]:
    """Configurations that bring the flange to poses, by damped Newton steps.

    Args:
        robot: the arm.
        targets: (v, 4, 4) wanted ``T_base_flange``.
        starts: (v, n) where each search begins [rad].
        rounds: at most.

    Returns:
        (v, n) configurations within the limits, and (v,) whether each reaches its pose to
        0.01 mm and 0.001 deg.
    """
    q = np.array(starts, float, copy=True)
    lower, upper = robot.limits.lower, robot.limits.upper
    done = np.zeros(len(q), bool)
    active = np.arange(len(q))
    for _ in range(rounds):
        _, frames, flange = joint_frames(robot, q[active])
        error = se3.logs(se3.inverses(flange) @ targets[active])
        reached = (np.abs(error[:, :3]).max(1) < 1e-5) & (np.abs(error[:, 3:]).max(1) < 2e-5)
        done[active[reached]] = True
        active, error = active[~reached], error[~reached]
        if not len(active):
            break
        J = body_screws(robot, frames[:, ~reached], flange[~reached])
        J_t = np.swapaxes(J, 1, 2)
        damping = 1e-6 + 1e-3 * np.sum(error**2, axis=1)[:, None, None]
        step = (J_t @ np.linalg.solve(J @ J_t + damping * np.eye(6), error[..., None]))[..., 0]
        longest = np.abs(step).max(1, keepdims=True)
        q[active] += step * np.minimum(1.0, 0.4 / np.maximum(longest, 1e-12))
    turn = 2 * np.pi
    q = np.where(q > upper, q - turn * np.ceil((q - upper) / turn), q)
    q = np.where(q < lower, q + turn * np.ceil((lower - q) / turn), q)
    inside = np.all((q >= lower - 1e-9) & (q <= upper + 1e-9), axis=1)
    return q, done & inside


def reach_some(
    robot: Robot, targets: Poses, rng: np.random.Generator, tries: int = 4
) -> tuple[JointPath, Mask]:
    """(v, n) configurations and (v,) whether each pose is reached, from a few random starts."""
    q = np.tile(robot.home, (len(targets), 1)).astype(float)
    ok = np.zeros(len(targets), bool)
    for attempt in range(tries):
        left = np.flatnonzero(~ok)
        if not len(left):
            break
        spread = 0.4 if attempt == 0 else 1.5
        starts = robot.home + rng.normal(0, spread, (len(left), robot.n))
        starts = np.clip(starts, robot.limits.lower, robot.limits.upper)
        answer, good = reach(robot, targets[left], starts)
        q[left[good]] = answer[good]
        ok[left[good]] = True
    return q, ok
