"""Where the tool should be and how it should point: goals of the laws, and the joints for them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, JointVector, Vector3
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot


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


def pose_error(robot: Robot, q: JointVector, aim: Aim) -> Floats:
    """(6,) error of the tip [m], and of its axis and roll [rad], in ``base``."""
    T = tcp_pose(robot, q)
    z, y = T[:3, 2], T[:3, 1]
    turn = np.cross(z, aim.axis)
    sine, cosine = float(np.linalg.norm(turn)), float(z @ aim.axis)
    if cosine < 0.0 and sine < 1e-6:
        turn, sine = T[:3, 0].copy(), 1.0
    angle = np.arctan2(sine, cosine)
    turn = turn * (angle / max(sine, 1e-9))
    down = aim.down - z * (z @ aim.down)
    length = float(np.linalg.norm(down))
    roll = 0.0
    if length > 0.1:
        down = down / length
        roll = float(np.arctan2(np.cross(y, down) @ z, y @ down))
    return np.concatenate([aim.position - T[:3, 3], turn + roll * z])


def joints_for(
    robot: Robot,
    aim: Aim,
    start: JointVector,
    weights: Weights | None = None,
    rounds: int = 4,
    most: float = 0.25,
) -> JointVector:
    """(n,) joints that minimise V's cost (eq. 2) near a start, by damped Gauss-Newton [rad].

    ``f = |y* - y|^2_W1 + |a* - a|^2_W2 + |q* - q|^2_C`` with a* the wanted direction; the last
    term is what damps each round. A round turns no joint by more than ``most`` [rad].
    """
    weights = weights or Weights()
    q = np.array(start, float)
    limits = robot.limits
    C = np.diag(_fitting(weights.posture, robot.n) ** 2)
    for _ in range(rounds):
        e = pose_error(robot, q, aim)
        J = tcp_jacobian(robot, q)
        W = _task_weights(tcp_pose(robot, q)[:3, 2], weights)
        A = W @ J
        step = np.linalg.solve(A.T @ A + C, A.T @ (W @ e))
        step *= min(1.0, most / max(float(np.abs(step).max()), 1e-9))
        q = np.clip(q + step, limits.lower + 0.01, limits.upper - 0.01)
    return q


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


def _task_weights(z: Vector3, weights: Weights) -> Floats:
    """(6, 6) square root of W1 and W2: turns about the tool's own axis weigh less."""
    along = np.outer(z, z)
    W = np.zeros((6, 6))
    W[:3, :3] = weights.position * np.eye(3)
    W[3:, 3:] = weights.axis * (np.eye(3) - along) + weights.roll * along
    return W


def _fitting(values: Floats, n: int) -> Floats:
    return np.resize(values, n)
