"""From landmarks in a picture to an arm's pose and joints.

No start is needed: some thousand configurations of the arm, seen from far in a hundred directions,
are compared with the landmarks in closed form (a turn, scale and shift in the picture), and the
best are followed to the end on the exact projection, with the joints' limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armsight.arrays import Floats, Floats32, Ints, JointVector, Points, Pose
from armsight.geometry.pose import make_pose
from armsight.recognition.any_arm.kernels import equations, refine, upright_cost, weak_perspective
from armsight.recognition.any_arm.landmarks import Landmarks
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Robot

SHAPES = 1500
VIEWS = 120
STARTS = 14
FOLLOWED = 5
"""Starts that are followed to the end."""
ALIKE = 0.02
"""Joints of two fits that are one lie within this [m]."""
_COARSE, _FINE, _NEAR = 8, 25, 6
_SURE = 1e10
"""The same of joints that are known."""
_HOLD = (1e-3, 0.05)
"""Information of the prior that keeps the pose and the joints where they are: [1/rad^2]."""


@dataclass(frozen=True)
class Observations:
    """Points of an arm seen in a picture.

    Attributes:
        link: (m,) that carries each; point: (m, 3) in its frame [m].
        at: (m, 2) where each is seen, x / z and y / z.
        covariance: (m, 2, 2) of ``at``.
        far: (m,) whether the search from far looks at it.
    """

    link: Ints
    point: Floats
    at: Floats
    covariance: Floats
    far: Floats


@dataclass(frozen=True)
class Fit:
    """An arm that explains observations.

    Attributes:
        robot: whose.
        T_camera_base: its pose; q: (n,) joints [rad].
        cost: sum of the observations' robust costs, and of what is unusual.
        information: (6 + n, 6 + n) of the turn about the base's origin, the shift and the joints.
    """

    robot: Robot
    T_camera_base: Pose
    q: JointVector
    cost: float
    information: Floats

    def joints(self) -> Points:
        """(n, 3) joint origins in the camera's frame [m]."""
        T = self.T_camera_base @ link_poses(self.robot, self.q)
        return np.asarray(T[1:, :3, 3])

    def joint_covariances(self) -> Floats:
        """(n, 3, 3) of the joint origins [m^2], first order."""
        n = self.robot.n
        T = link_poses(self.robot, self.q)
        R = self.T_camera_base[:3, :3]
        spread = np.linalg.inv(self.information)
        out = np.empty((n, 3, 3))
        for k in range(n):
            b = T[k + 1, :3, 3]
            c = R @ b
            J = np.zeros((3, 6 + n))
            J[:, :3] = -np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
            J[:, 3:6] = np.eye(3)
            for j in range(k):
                axis = T[j + 1, :3, :3] @ self.robot.axis[j]
                J[:, 6 + j] = R @ np.cross(axis, b - T[j + 1, :3, 3])
            out[k] = J @ spread @ J.T
        return out


def solve(
    robot: Robot,
    marks: Landmarks,
    seen: Observations,
    first: Fit | None = None,
    known: JointVector | None = None,
) -> list[Fit]:
    """The arms that explain the observations, best first; none if too little is seen.

    Args:
        robot: that is looked for.
        marks: its landmarks; the observations that ``far`` names are these, in their order.
        seen: what is seen.
        first: an earlier answer for the same arm, which is tried as well.
        known: (n,) joints where they are known [rad]: only the pose is looked for.
    """
    if (seen.far > 0).sum() < 5:
        return []
    starts = far_starts(robot, marks, seen, known)
    if first is not None:
        starts = [(first.T_camera_base[:3, :3], first.T_camera_base[:3, 3], first.q), *starts]
    problem = _problem(robot, seen, known is not None)
    ends = []
    for R, t, q in starts:
        R, t, q = R.copy(), t.copy(), q.copy()
        cost = _follow(problem, R, t, q, _COARSE)
        ends.append(Fit(robot, make_pose(R, t), q, cost, np.eye(6 + robot.n)))
    return unlike([_followed(problem, end, _FINE) for end in unlike(ends)[:FOLLOWED]])


def unlike(fits: Sequence[Fit]) -> list[Fit]:
    """Those that differ, best first: many starts end in the same place."""
    kept: list[Fit] = []
    places: list[Points] = []
    for fit in sorted(fits, key=lambda f: f.cost):
        joints = fit.joints()
        if all(np.linalg.norm(joints - other, axis=1).max() > ALIKE for other in places):
            kept.append(fit)
            places.append(joints)
    return kept


def again(fit: Fit, seen: Observations, known: bool = False) -> Fit:
    """A fit followed on from where it is, on other observations; known: its joints are kept."""
    return _followed(_problem(fit.robot, seen, known), fit, _NEAR)


def cost_of(fit: Fit, seen: Observations) -> float:
    """What a fit costs on other observations than it was made from."""
    T, q = fit.T_camera_base, fit.q
    problem = _problem(fit.robot, seen, known=False)
    return _follow(problem, T[:3, :3].copy(), T[:3, 3].copy(), q.copy(), 0)


@dataclass(frozen=True)
class _Problem:
    """Observations as the compiled loops take them."""

    robot: Robot
    seen: Observations
    whiten: Floats
    limits: Floats
    hold: Floats


def _problem(robot: Robot, seen: Observations, known: bool) -> _Problem:
    limits = np.stack([robot.limits.lower, robot.limits.upper], 1).astype(np.float64)
    hold = np.concatenate([np.full(6, _HOLD[0]), np.full(robot.n, _SURE if known else _HOLD[1])])
    limits = np.clip(limits, -2 * np.pi, 2 * np.pi)
    return _Problem(robot, seen, _whitening(seen.covariance), limits, hold)


def _follow(problem: _Problem, R: Floats, t: Floats, q: JointVector, steps: int) -> float:
    """Move a start downhill; its cost there."""
    robot, seen = problem.robot, problem.seen
    cost = refine(
        R, t, q, robot.T_link_joint, robot.axis, seen.link, seen.point, seen.at, problem.whiten,
        problem.limits, problem.hold, steps,
    )  # fmt: skip
    return float(cost) + _unusual(R)


def _followed(problem: _Problem, fit: Fit, steps: int) -> Fit:
    robot, seen = problem.robot, problem.seen
    R, t, q = fit.T_camera_base[:3, :3].copy(), fit.T_camera_base[:3, 3].copy(), fit.q.copy()
    cost = _follow(problem, R, t, q, steps)
    H, g = np.zeros((6 + robot.n, 6 + robot.n)), np.zeros(6 + robot.n)
    equations(
        R, t, q, robot.T_link_joint, robot.axis, seen.link, seen.point, seen.at, problem.whiten,
        problem.limits, H, g,
    )  # fmt: skip
    # What no landmark tells has the spread of a joint's range.
    H += np.diag(
        np.maximum(problem.hold, np.concatenate([np.full(6, 1e-6), np.full(robot.n, 0.1)]))
    )
    return Fit(robot, make_pose(R, t), q, cost, H)


def _unusual(R: Floats) -> float:
    return float(upright_cost(-R[1, 2], float(np.hypot(R[0, 2], R[1, 2]))))


def far_starts(
    robot: Robot, marks: Landmarks, seen: Observations, known: JointVector | None = None
) -> list[tuple[Floats, Floats, JointVector]]:
    """Rotations, translations and joints that explain the landmarks as seen from far."""
    configurations, shapes, frames = _shapes(robot, marks, known)
    of_marks = np.flatnonzero(seen.far >= 0)[: len(marks.link)]
    trace = 0.5 * np.trace(seen.covariance[of_marks], axis1=1, axis2=2)
    # Whoever is surest shall not decide alone: the views are coarse.
    floor = (0.03 * max(float(np.ptp(seen.at[of_marks], axis=0).max()), 1e-3)) ** 2
    weight = (seen.far[of_marks] / (trace + floor)).astype(np.float32)
    cost = np.empty(len(shapes), np.float32)
    found = np.empty((len(shapes), 5), np.float32)
    at = seen.at[of_marks].astype(np.float32)
    if known is None:
        weak_perspective(shapes, frames, at, weight, cost, found)
    else:
        # One shape, and each view a candidate of its own.
        for d in range(len(frames)):
            one = slice(d, d + 1)
            weak_perspective(shapes[one], frames[one], at, weight, cost[one], found[one])
            found[d, 0] = d
    out = []
    for i in np.argsort(cost)[:STARTS]:
        view, re, im, x, y = found[i].astype(float)
        size = max(float(np.hypot(re, im)), 1e-6)
        c, s = re / size, im / size
        flat = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        R = flat @ frames[int(view)].astype(float)
        depth = 1.0 / size
        middle = float((weight @ (shapes[i] @ R[2])) / weight.sum())
        z = max(depth - middle, 0.15)
        out.append((R, np.array([x * depth, y * depth, z]), configurations[i].copy()))
    return out


def _shapes(
    robot: Robot, marks: Landmarks, known: JointVector | None
) -> tuple[Floats, Floats32, Floats32]:
    """Configurations, landmarks in them, and views."""
    if known is not None:
        views = _views()
        shape = marks.placed(link_poses(robot, known)).astype(np.float32)
        return np.tile(known, (len(views), 1)), np.tile(shape, (len(views), 1, 1)), views
    return _library(_Asked(robot, marks))


@dataclass(frozen=True)
class _Asked:
    """A robot and its landmarks, which can be looked up: arrays cannot.

    By themselves, not by a name: a user's own arm may be called as one of the catalogue is.
    """

    robot: Robot
    marks: Landmarks

    def __hash__(self) -> int:
        return hash((id(self.robot), self.marks.point.tobytes()))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, _Asked)
            and other.robot is self.robot
            and np.array_equal(other.marks.point, self.marks.point)
            and np.array_equal(other.marks.link, self.marks.link)
        )


@lru_cache(maxsize=16)
def _library(asked: _Asked) -> tuple[Floats, Floats32, Floats32]:
    """Configurations of a robot, its landmarks in them, and views."""
    robot, marks = asked.robot, asked.marks
    rng = np.random.default_rng(20)
    lower, upper = (np.clip(v, -np.pi, np.pi) for v in (robot.limits.lower, robot.limits.upper))
    q = rng.uniform(lower, upper, (SHAPES, robot.n))
    # Turning the first joint is turning the base; the last one moves next to nothing.
    q[:, 0] = np.clip(0.0, lower[0], upper[0])
    shapes = np.stack([marks.placed(link_poses(robot, row)) for row in q]).astype(np.float32)
    return q, shapes, _views()


def _views() -> Floats32:
    """(VIEWS, 3, 3) directions over the sphere (Fibonacci's), rows the camera's axes."""
    k = np.arange(VIEWS) + 0.5
    z = 1.0 - 2.0 * k / VIEWS
    angle = np.pi * (1.0 + 5.0**0.5) * k
    radius = np.sqrt(1.0 - z * z)
    forward = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], 1)
    helper = np.where(np.abs(forward[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], 1).astype(np.float32)


def _whitening(covariance: Floats) -> Floats:
    """(m, 2, 2) W with W^T W the inverse of each covariance, in closed form."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    W = np.zeros_like(covariance)
    W[:, 0, 0] = np.sqrt(c / (a * c - b * b))
    W[:, 1, 1] = 1.0 / np.sqrt(c)
    W[:, 0, 1] = -W[:, 0, 0] * b / c
    return W
