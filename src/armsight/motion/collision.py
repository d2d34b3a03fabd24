"""Whether the arm touches anything: one configuration, a straight motion, a path, a trajectory."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.body import make_body
from armsight.motion.kernels import (
    Obstacles,
    Scratch,
    body_centers,
    config_free,
    edge_free,
    make_scratch,
    nearest_pair,
    pair_gap,
    path_clear,
    path_free,
    self_clearance,
    sphere_clearances,
    trajectory_blocked,
)
from armsight.motion.obstacles import CollisionConfig, obstacles_of
from armsight.motion.trajectory import Trajectory
from armsight.robots.robot import Robot


class CollisionModel:
    """Collision checks of one robot against snapshots, itself included. Safe to share by threads.

    A motion is judged for a body that stands at the motion's first configuration: unknown voxels
    close to it are excused (see :mod:`armsight.motion.obstacles`). Single configurations are
    judged strictly unless ``at`` says where the body is.

    What is no position of the arm (another number of joints, not finite) is never free; a clearance
    of it, and a path or a trajectory of another number of joints, raise ValueError.
    """

    def __init__(self, robot: Robot, config: CollisionConfig | None = None) -> None:
        self.robot = robot
        self.config = config or CollisionConfig()
        self.body = make_body(robot, self.config.margin)
        self._local = threading.local()

    def with_room(self, room: float) -> CollisionModel:
        """One that keeps so much more clearance [m]: what it allows, the planner's paths do."""
        given = self.config
        config = replace(given, margin=given.margin + room, excuse=given.excuse - room)
        return CollisionModel(self.robot, config)

    def obstacles(self, snapshot: WorkspaceSnapshot, at: JointVector | None = None) -> Obstacles:
        """The snapshot as the kernels read it, for a body at ``at`` (n,) [rad]."""
        key = None if at is None else np.asarray(at, float).tobytes()
        known = getattr(self._local, "obstacles", None)
        if known is not None and known[0] is snapshot and known[1] == key:
            return known[2]
        result = obstacles_of(snapshot, self.body, self.config, at)
        self._local.obstacles = (snapshot, key, result)
        return result

    def scratch(self) -> Scratch:
        """This thread's working memory."""
        if not hasattr(self._local, "scratch"):
            self._local.scratch = make_scratch(self.body)
        return self._local.scratch

    def within_limits(self, q: JointVector) -> bool:
        """Whether (n,) positions, or all of (k, n), are finite and inside the joint limits."""
        q = np.asarray(q, float)
        if q.shape[-1:] != self.body.lower.shape:
            return False
        return bool(
            np.isfinite(q).all() and (q >= self.body.lower).all() and (q <= self.body.upper).all()
        )

    def inside_limits(self, q: JointVector, tolerance: float = 0.02) -> JointVector:
        """(n,) positions, those beyond a limit by no more than ``tolerance`` [rad] put on it.

        Encoders are noisy: an arm that stands at a limit may report to be just beyond it.
        """
        q = np.asarray(q, float)
        if q.shape != self.body.lower.shape:
            return q
        inside = np.clip(q, self.body.lower, self.body.upper)
        return np.where(np.abs(inside - q) <= tolerance, inside, q)

    def clearances(
        self, q: JointVector, snapshot: WorkspaceSnapshot, at: JointVector | None = None
    ) -> Floats:
        """(m,) clearance of each moving sphere from the surroundings [m]; negative: it touches.

        A lower bound far away, exact within a voxel of contact. ``model.body.original`` tells
        which spheres of the robot these are.
        """
        scratch = self.scratch()
        body_centers(self.body, self._position(q), scratch.centers)
        out = np.empty(len(self.body.radius))
        ob = self.obstacles(snapshot, at)
        sphere_clearances(ob, scratch.centers, self.body.radius, out)
        return out

    def clearance(
        self, q: JointVector, snapshot: WorkspaceSnapshot, at: JointVector | None = None
    ) -> float:
        """Least clearance of the body at (n,) [rad] from surroundings and itself [m]."""
        out = self.clearances(q, snapshot, at)
        own = self_clearance(self.body, self.scratch().centers)
        return float(min(out.min(initial=np.inf), own))

    def valid(
        self, q: JointVector, snapshot: WorkspaceSnapshot, at: JointVector | None = None
    ) -> bool:
        """Whether (n,) positions are within the limits and touch nothing."""
        return self.within_limits(q) and bool(
            config_free(self.body, self.obstacles(snapshot, at), _vector(q), self.scratch())
        )

    def edge_valid(
        self,
        q0: JointVector,
        q1: JointVector,
        snapshot: WorkspaceSnapshot,
        at: JointVector | None = None,
    ) -> bool:
        """Whether the straight joint motion is proven to touch nothing, ends included.

        The proof covers every point of the motion, not samples of it.
        """
        if not (self.within_limits(q0) and self.within_limits(q1)):
            return False
        q0 = _vector(q0)
        ob = self.obstacles(snapshot, q0 if at is None else at)
        return bool(edge_free(self.body, ob, q0, _vector(q1), self.scratch()))

    def first_blocked(
        self,
        path: JointPath,
        snapshot: WorkspaceSnapshot,
        at: JointVector | None = None,
        own: bool = True,
    ) -> int | None:
        """Index of the first segment of a (k, n) path that is not proven free, or None.

        Args:
            path: joint positions [rad].
            snapshot: the surroundings.
            at: where the body is now; at the path's beginning if left out.
            own: whether the body may touch itself on the way; not to be asked again for a path
                that was proven before, as that does not depend on the surroundings.
        """
        path = np.ascontiguousarray(path, np.float64)
        if path.ndim != 2 or path.shape[1] != self.robot.n:
            raise ValueError(f"a path has shape {path.shape}, expected (k, {self.robot.n})")
        inside = (path >= self.body.lower) & (path <= self.body.upper)
        if not inside.all():  # what is not a number is not inside
            return max(int(np.argmin(inside.all(axis=1))) - 1, 0)
        ob = self.obstacles(snapshot, path[0] if at is None else at)
        prove = path_free if own or len(path) < 2 else path_clear
        index = int(prove(self.body, ob, path, self.scratch()))
        return None if index < 0 else index

    def path_valid(
        self, path: JointPath, snapshot: WorkspaceSnapshot, at: JointVector | None = None
    ) -> bool:
        """Whether every segment of a (k, n) path is proven free."""
        return self.first_blocked(path, snapshot, at) is None

    def first_blocked_time(
        self,
        trajectory: Trajectory,
        snapshot: WorkspaceSnapshot,
        begin: float = 0.0,
        until: float = float("inf"),
        at: JointVector | None = None,
    ) -> float | None:
        """A time [s] at which a motion is not proven free between two of its times, or None.

        Not always the earliest one. The whole curve is proven, not samples of it; joint limits
        are checked at the ends of its pieces.
        """
        t = trajectory
        if t.n != self.robot.n:
            raise ValueError(
                f"a trajectory is of {t.n} joints, {self.robot.name} has {self.robot.n}"
            )
        inside = (t.q >= self.body.lower - 1e-9) & (t.q <= self.body.upper + 1e-9)
        for k in np.flatnonzero(~inside.all(axis=1)):
            if begin <= t.times[k] <= until:
                return float(t.times[k])
        begin, until = min(begin, t.duration), min(until, t.duration)
        here = t.position(begin) if at is None else at
        if until <= begin:
            return None if self.valid(t.position(begin), snapshot, here) else begin
        blocked = trajectory_blocked(
            self.body,
            self.obstacles(snapshot, here),
            t.times,
            t.q,
            t.qd,
            t.qdd,
            t.jerk,
            float(begin),
            float(until),
            self.scratch(),
        )
        return None if blocked < 0.0 else float(blocked)

    def trajectory_valid(
        self,
        trajectory: Trajectory,
        snapshot: WorkspaceSnapshot,
        begin: float = 0.0,
        until: float = float("inf"),
        at: JointVector | None = None,
    ) -> bool:
        """Whether a motion is proven free between two of its times [s], from rest to rest."""
        return self.first_blocked_time(trajectory, snapshot, begin, until, at) is None

    def contact(
        self, q: JointVector, snapshot: WorkspaceSnapshot, at: JointVector | None = None
    ) -> str:
        """What (n,) positions touch, in words; empty when nothing."""
        q = np.asarray(q, float)
        if q.shape != self.body.lower.shape or not np.isfinite(q).all():
            return "joint positions that are not numbers"
        for j, name in enumerate(self.robot.joint_names):
            if not self.body.lower[j] <= q[j] <= self.body.upper[j]:
                return (
                    f"{name} at {q[j]:.3f} rad is outside its limits "
                    f"{self.body.lower[j]:.3f}..{self.body.upper[j]:.3f}"
                )
        if self.valid(q, snapshot, at):
            return ""
        out = self.clearances(q, snapshot, at)
        worst = int(np.argmin(out)) if len(out) else -1
        if worst >= 0 and out[worst] < self.config.floor:
            x, y, z = self.scratch().centers[worst]
            link = self.robot.link_names[int(self.body.link[worst])]
            return f"{link} touches something near ({x:.2f}, {y:.2f}, {z:.2f}) m"
        return f"the arm touches itself: {self.own_gap(q)[1]}"

    def own_gap(self, q: JointVector) -> tuple[float, str]:
        """Least distance [m] between parts of the arm at (n,) [rad], and which two, in words.

        Negative where they touch; infinite, and no words, where none can.
        """
        body, centers = self.body, self.scratch().centers
        body_centers(body, self._position(q), centers)
        pair = nearest_pair(body, centers)
        if pair < 0:
            return math.inf, ""
        links = np.concatenate([body.link, body.fixed_link])[body.pairs[pair]]
        first, second = (self.robot.link_names[int(link)] for link in links)
        return pair_gap(body, centers, pair), f"{first} its {second}"

    def _position(self, q: JointVector) -> JointVector:
        q = _vector(q)
        if q.shape != self.body.lower.shape or not np.isfinite(q).all():
            raise ValueError(f"joint positions are {q.tolist()}, expected {self.robot.n} numbers")
        return q


def _vector(q: JointVector) -> JointVector:
    return np.ascontiguousarray(q, np.float64)
