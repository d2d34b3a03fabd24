"""Where the tool should be and how it should point: goals of the laws, and the joints for them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, JointVector, Pose, Vector3
from armsight.geometry.pose import make_pose
from armsight.robots.kinematics import link_poses, tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.aim_kernels import Chain, Cost, Goal, aimed_joints, highest, tip_error
from armsight.servoing.ceiling import HARD, LEAST, NEAR, RISES, Ceiling


@dataclass(frozen=True)
class Aim:
    """A goal of the TCP.

    Attributes:
        position: (3,) [m]; velocity: (3,) [m/s], both in ``base``.
        axis: (3,) unit: where the tool's z should point.
        down: (3,) unit: where the tool's y should point as far as the axis lets it; the pair hangs
            on the other side.
    """

    position: Vector3
    velocity: Vector3
    axis: Vector3
    down: Vector3


@dataclass(frozen=True)
class Weights:
    """Diagonal weights of V's cost (eq. 2): V gives none, these are ours.

    Attributes:
        position: of the tip, W1; axis: of its direction, W2 [m/rad]; roll: about it [m/rad].
        posture: of the joints' way, C [m/rad].
    """

    position: float = 1.0
    axis: float = 0.10
    roll: float = 0.03
    posture: Floats = field(default_factory=lambda: np.full(6, 0.004))


def aim_pose(aim: Aim) -> Pose:
    """``T_base_tcp`` of a tool that is at an aim, pointing as it shall."""
    y = aim.down - aim.axis * float(aim.axis @ aim.down)
    y = y / max(float(np.linalg.norm(y)), 1e-9)
    return make_pose(np.stack([np.cross(y, aim.axis), y, aim.axis], axis=1), aim.position)


def pose_error(robot: Robot, q: JointVector, aim: Aim) -> Floats:
    """(6,) error of the tip [m], and of its axis and roll [rad], in ``base``."""
    return np.asarray(tip_error(np.ascontiguousarray(tcp_pose(robot, q)), _goal(aim)))


def joints_for(
    robot: Robot,
    aim: Aim,
    start: JointVector,
    weights: Weights | None = None,
    rounds: int = 4,
    most: float = 0.25,
    ceiling: Ceiling | None = None,
) -> JointVector:
    """(n,) joints that minimise V's cost (eq. 2) near a start, by damped Gauss-Newton [rad].

    ``f = |y* - y|^2_W1 + |a* - a|^2_W2 + |q* - q|^2_C`` with a* the wanted direction; the last
    term is what damps each round. A round turns no joint by more than ``most`` [rad], and leads no
    part above the ceiling.
    """
    cost = _cost(weights or Weights(), robot.n, ceiling)
    begin = np.array(start, float)
    return np.asarray(aimed_joints(_chain(robot), cost, _goal(aim), begin, rounds, most))


def held_under(robot: Robot, q: JointVector, motion: JointVector, ceiling: Ceiling) -> JointVector:
    """(n,) joint velocities [rad/s] nearest to wanted ones that lead no part above a ceiling.

    The highest part rises no faster than ``RISES`` times the room that it has; above the ceiling it
    comes down.
    """
    chain = _chain(robot)
    poses = np.ascontiguousarray(link_poses(robot, q))
    top, rise = highest(poses, chain, np.ascontiguousarray(ceiling.up, float))
    excess = float(rise @ motion) - RISES * (ceiling.height - top)
    square = float(rise @ rise)
    if excess <= 0.0 or square < 1e-6:
        return motion
    return np.asarray(motion - rise * (excess / square))


def joint_velocity(
    robot: Robot, q: JointVector, linear: Vector3, weights: Weights | None = None
) -> JointVector:
    """(n,) joint velocities that carry the tip with a velocity [m/s], turning it little [rad/s]."""
    weights = weights or Weights()
    J = tcp_jacobian(robot, q)
    W = _task_weights(tcp_pose(robot, q)[:3, 2], weights)
    A = W @ J
    C = np.diag(_fitting(weights.posture, robot.n) ** 2)
    twist = np.concatenate([linear, np.zeros(3)])
    return np.asarray(np.linalg.solve(A.T @ A + C, A.T @ (W @ twist)))


def _goal(aim: Aim) -> Goal:
    return Goal(*(np.ascontiguousarray(v, float) for v in (aim.position, aim.axis, aim.down)))


def _chain(robot: Robot) -> Chain:
    spheres, limits = robot.spheres, robot.limits
    tip = robot.T_last_flange
    if robot.tool is not None:
        tip = tip @ robot.tool.T_flange_tcp
    rises = np.asarray(spheres.link) > 1
    return Chain(
        np.ascontiguousarray(robot.T_link_joint), np.ascontiguousarray(robot.axis),
        np.ascontiguousarray(tip), np.ascontiguousarray(limits.lower, float),
        np.ascontiguousarray(limits.upper, float), np.asarray(spheres.link, np.int64)[rises],
        np.ascontiguousarray(np.asarray(spheres.center, float)[rises]),
        np.asarray(spheres.radius, float)[rises],
    )  # fmt: skip


def _cost(weights: Weights, n: int, ceiling: Ceiling | None) -> Cost:
    up, height = (np.zeros(3), np.inf) if ceiling is None else (ceiling.up, ceiling.height)
    return Cost(
        weights.position, weights.axis, weights.roll, _fitting(weights.posture, n),
        np.ascontiguousarray(up, float), height, HARD, NEAR, LEAST,
    )  # fmt: skip


def _task_weights(z: Vector3, weights: Weights) -> Floats:
    """(6, 6) square root of W1 and W2: turns about the tool's own axis weigh less."""
    along = np.outer(z, z)
    W = np.zeros((6, 6))
    W[:3, :3] = weights.position * np.eye(3)
    W[3:, 3:] = weights.axis * (np.eye(3) - along) + weights.roll * along
    return W


def _fitting(values: Floats, n: int) -> Floats:
    return np.resize(values, n)
