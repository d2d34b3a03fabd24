"""Inverse kinematics: joint positions that bring the tip to a pose."""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.geometry.pose import is_rotation
from armsight.motion.body import aligned_chain
from armsight.motion.ik_kernels import solve
from armsight.robots.robot import Robot


def solve_ik(
    robot: Robot,
    T_base_tcp: Pose,
    seed_q: JointVector | None,
    rng: np.random.Generator,
    *,
    wanted: int = 8,
    starts: int = 100,
) -> list[JointVector]:
    """Joint positions within the limits that bring the tip to a pose, nearest to the seed first.

    Damped least squares from the seed and from random starts; of a 7-axis arm's endless solutions
    a few are returned. Whether they touch anything is not looked at.

    Args:
        robot: the arm; its tip is the tool's working point, or the flange.
        T_base_tcp: wanted pose.
        seed_q: (n,) tried first; the home position when None.
        rng: draws the other starts.
        wanted: most solutions returned.
        starts: tried before giving up; 100 find all but a few in a thousand of the reachable poses.

    Returns:
        (n,) solutions, exact to 1e-7 m and rad; empty when none was found: out of reach, most
        likely.

    Raises:
        ValueError: the pose is not a rigid transform, or ``wanted`` or ``starts`` is below 1.
    """
    T = np.ascontiguousarray(T_base_tcp, np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all() or not is_rotation(T[:3, :3]):
        raise ValueError("solve_ik: T_base_tcp is not a rigid transform (4 x 4, rotation, finite)")
    if wanted < 1 or starts < 1:
        raise ValueError("solve_ik: wanted and starts must be at least 1")
    rotation, offset, turns = aligned_chain(robot)
    T_last_tcp = (
        robot.T_last_flange
        if robot.tool is None
        else (robot.T_last_flange @ robot.tool.T_flange_tcp)
    )
    aligned_tip = T_last_tcp.copy()
    aligned_tip[:3] = turns[-1].T @ T_last_tcp[:3]
    seed = robot.home if seed_q is None else np.asarray(seed_q, float)
    lower, upper = robot.limits.lower, robot.limits.upper
    seed = np.clip(np.where(np.isfinite(seed), seed, robot.home), lower, upper)
    tried = np.concatenate([seed[None], rng.uniform(lower, upper, (starts - 1, robot.n))])
    found = solve(
        rotation, offset, aligned_tip, lower, upper, T, np.ascontiguousarray(tried), wanted
    )
    found = np.array([_unwound(q, seed, lower, upper) for q in found]).reshape(-1, robot.n)
    order = np.argsort(np.abs(found - seed).max(axis=1), kind="stable")
    return list(found[order])


def _unwound(
    q: JointVector, seed: JointVector, lower: JointVector, upper: JointVector
) -> JointVector:
    """The same pose with each joint turned by whole turns to be nearest to the seed.

    Nearest of those within the limits: beyond a limit the seed's own turn may be none of them.
    """
    turn = 2.0 * np.pi
    least, most = np.ceil((lower - q) / turn), np.floor((upper - q) / turn)
    # What is within the limits stays there, whatever is rounded.
    turns = np.clip(np.round((seed - q) / turn), np.minimum(least, 0.0), np.maximum(most, 0.0))
    return np.clip(q + turn * turns, lower, upper)
