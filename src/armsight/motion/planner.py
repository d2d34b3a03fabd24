"""The predictive planner: RRT-Connect on proven edges, many solutions, the cheapest is improved.

T2 lets RRT-Connect run until its time limit (1 s, three attempts) and executes the cheapest of the
paths found. Here the first path mostly comes within milliseconds; the time limit is for finding it,
and only ``PlannerConfig.improvement`` is then spent on other paths and on cheaper ones. Trees that
have grown full are planted anew, so attempts need no counting.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.danger import ALPHA
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.cable_kernels import CableWay
from armsight.motion.collision import CollisionModel
from armsight.motion.cost import danger_of
from armsight.motion.cost_kernels import Danger, path_cost_kernel
from armsight.motion.data import PlanRequest
from armsight.motion.escape import escape
from armsight.motion.improve_kernels import improve
from armsight.motion.kernels import Obstacles, edge_free, path_free
from armsight.motion.led_cable import LedCable, first_touch
from armsight.motion.plan import Plan, failed, refusal
from armsight.motion.planner_kernels import (
    FULL,
    SOLVED,
    Forest,
    make_forest,
    plant,
    rrt_connect,
    traced,
)
from armsight.motion.timing import time_parameterise
from armsight.motion.trajectory import Trajectory, join, straight
from armsight.robots.robot import JointLimits, Robot

CHUNK = 10_000
"""Looks between two glances at the wall clock."""
FINALISTS = 2
"""Paths that are improved beyond the first round."""


@dataclass(frozen=True)
class PlannerConfig:
    """How the planner works.

    Attributes:
        step: longest edge of the trees [rad].
        room: paths keep this much more clearance than motions must [m].
        nodes: most nodes of a tree before it is planted anew.
        solutions: paths wanted before the cheapest is improved.
        improvement: time for more solutions and improvement after the first [s].
        looks_per_second: body poses that count as one second. Budgets are kept in this unit, so
            that a plan depends on the seed and not on the machine's load.
        wall_limit: also stop at this many times the asked times on the wall clock; None for never
            (simulations that must repeat bit for bit).
        alpha: decay of danger [1/s].
        speed, acceleration: share of the robot's limits (T2: 50 % and 60 %).
    """

    step: float = 2.0
    room: float = 0.001
    nodes: int = 20_000
    solutions: int = 6
    improvement: float = 0.02
    looks_per_second: float = 4.0e5
    wall_limit: float | None = None
    alpha: float = ALPHA
    speed: float = 0.5
    acceleration: float = 0.6


class RrtConnectPlanner:
    """Plans for one robot; not to be shared by threads.

    Args:
        robot: the arm.
        model: collision checks; made from the robot when None.
        config: how it works.
        limits: of the motion in time; the robot's, scaled by the configuration, when None.
        clock: what a plan's seconds and ``wall_limit`` are measured by [s]; ``time.thread_time``
            where other programs would disturb a measurement.
    """

    def __init__(
        self,
        robot: Robot,
        model: CollisionModel | None = None,
        config: PlannerConfig | None = None,
        limits: JointLimits | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.robot = robot
        self.model = model or CollisionModel(robot)
        self.config = config or PlannerConfig()
        self._clock = clock
        self.limits = limits or robot.limits.scaled(self.config.speed, self.config.acceleration)
        # Paths are proven with a little more room than motions: between the poses looked at, a
        # proof may use up the floor, and the motion's proof may look just there.
        self._roomy = self.model.with_room(self.config.room)
        self._forest: Forest = make_forest(self.config.nodes, robot.n)
        self._cable = LedCable.of(robot)

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`."""
        began = self._clock()

        def fail(reason: str) -> Plan:
            seconds = self._clock() - began
            return failed(request, snapshot, self.robot.n, reason, seconds)

        start = self.model.inside_limits(np.array(request.start, float))
        goal = np.array(request.target, float)
        way_out = np.zeros((0, self.robot.n))
        reason = refusal(self._roomy, start, goal, snapshot)
        if reason.startswith("start") and start.shape == goal.shape == (self.robot.n,):
            free = escape(self._roomy, start, snapshot, rng)
            if free is None:
                return fail(reason)
            way_out, start = start[None], free
            reason = refusal(self._roomy, start, goal, snapshot)
        if reason:
            return fail(reason)
        here = way_out[0] if len(way_out) else start
        ob = self._roomy.obstacles(snapshot, here)
        if self._cable is not None:
            ob = self._cable.among(ob, start, goal)
        end = None
        if self.config.wall_limit is not None:
            end = began + self.config.wall_limit * time_limit
        first, spent = self._first(ob, start, goal, request.warm, time_limit, rng, end)
        if first is None:
            led = "" if self._cable is None else "; its cable is led round things, too"
            return fail(f"no path found within {time_limit:g} s; {_extent(self._forest)}{led}")
        found = self._clock()
        danger = danger_of(snapshot, self.config.alpha)
        left = max(0.0, time_limit - spent / self.config.looks_per_second)
        seconds = min(self.config.improvement, left)
        if self.config.wall_limit is not None:
            end = found + self.config.wall_limit * seconds
        path, cost, count = self._cheapest(ob, danger, first, seconds, rng, end)
        motion, escape_s = self._motion(path, way_out, snapshot, here, ob.cable)
        return Plan(
            request.sequence,
            np.concatenate([way_out, path]),
            motion,
            cost,
            snapshot.sequence,
            found - began,
            self._clock() - found,
            "",
            count,
            escape_s,
        )

    def _motion(
        self,
        path: JointPath,
        way_out: JointPath,
        snapshot: WorkspaceSnapshot,
        here: JointVector,
        cable: CableWay,
    ) -> tuple[Trajectory, float]:
        """The proven motion along a path, after the way out; and how long that takes [s]."""

        def blocked(t: Trajectory) -> float | None:
            when = self.model.first_blocked_time(t, snapshot, at=here)
            return first_touch(cable, t) if when is None else when

        motion = time_parameterise(path, self.limits, blocked)
        if len(way_out) == 0:
            return motion, 0.0
        out = straight(way_out[0], path[0], self.limits)
        return join([out, motion]) if motion.duration > 0.0 else out, out.duration

    def _first(
        self,
        ob: Obstacles,
        start: JointVector,
        goal: JointVector,
        warm: JointPath | None,
        time_limit: float,
        rng: np.random.Generator,
        end: float | None,
    ) -> tuple[JointPath | None, int]:
        """First path, and looks spent."""
        body, scratch = self._roomy.body, self._roomy.scratch()
        scratch.looks[0] = 0
        known = np.asarray([] if warm is None else warm, float)
        if known.ndim == 2 and len(known) and self._roomy.within_limits(known):
            bent = joined_to(known, start, goal)
            if path_free(body, ob, bent, scratch) < 0:
                return bent, int(scratch.looks[0])
        if edge_free(body, ob, start, goal, scratch):
            return np.stack([start, goal]), int(scratch.looks[0])
        budget = int(time_limit * self.config.looks_per_second)
        path = self._one(ob, start, goal, budget, rng, end)
        return path, int(scratch.looks[0])

    def _one(
        self,
        ob: Obstacles,
        start: JointVector,
        goal: JointVector,
        budget: int,
        rng: np.random.Generator,
        end: float | None,
    ) -> JointPath | None:
        """A path by RRT-Connect, or None when the looks are spent."""
        body, scratch, forest = self._roomy.body, self._roomy.scratch(), self._forest
        # A turn more than this is never needed: the arm looks the same after it.
        forest.box[0] = np.maximum(body.lower, np.minimum(start, goal) - np.pi)
        forest.box[1] = np.minimum(body.upper, np.maximum(start, goal) + np.pi)
        last = int(scratch.looks[0]) + budget
        outcome = FULL
        while scratch.looks[0] < last and (end is None or self._clock() < end):
            if outcome == FULL:
                plant(forest, start, goal, _seed(rng))
            chunk = min(CHUNK, last - int(scratch.looks[0]))
            outcome = rrt_connect(body, ob, forest, self.config.step, chunk, scratch)
            if outcome == SOLVED:
                return traced(forest)
        return None

    def _cheapest(
        self,
        ob: Obstacles,
        danger: Danger,
        first: JointPath,
        seconds: float,
        rng: np.random.Generator,
        end: float | None,
    ) -> tuple[JointPath, float, int]:
        """The cheapest of several paths, improved; its cost; how many were found."""
        body, scratch = self._roomy.body, self._roomy.scratch()
        budget = int(seconds * self.config.looks_per_second)
        scratch.looks[0] = 0

        def better(path: JointPath, looks: int) -> JointPath:
            last = int(scratch.looks[0]) + looks
            while scratch.looks[0] < last and (end is None or self._clock() < end):
                before = int(scratch.looks[0])
                path = improve(
                    body, ob, danger, path, _seed(rng), min(CHUNK, last - before), scratch
                )
                if scratch.looks[0] == before:
                    break  # nothing to improve (a path of too many corners, or of no length)
            return path

        def cost(path: JointPath) -> float:
            return float(path_cost_kernel(body, danger, path, scratch))

        paths = [first]
        if len(first) > 2 or not danger.calm:
            part = budget // 10
            while len(paths) < self.config.solutions and scratch.looks[0] < part:
                rest = part - int(scratch.looks[0])
                other = self._one(ob, first[0], first[-1], rest, rng, end)
                if other is None:
                    break
                paths.append(other)
            paths = sorted((better(p, part // len(paths)) for p in paths), key=cost)
        count = len(paths)
        paths = paths[:FINALISTS]
        # The finalists get a third of what is left, the winner the rest.
        if len(paths) > 1:
            share = (budget - int(scratch.looks[0])) // (3 * len(paths))
            paths = sorted((better(p, share) for p in paths), key=cost)
        best = better(paths[0], budget - int(scratch.looks[0]))
        return best, cost(best), count


def joined_to(warm: JointPath, start: JointVector, goal: JointVector) -> JointPath:
    """A known path from start to goal: what of it lies ahead of the place nearest to the start."""
    ahead = warm
    if len(warm) > 1:
        a, step = warm[:-1], np.diff(warm, axis=0)
        size = np.maximum((step * step).sum(axis=1), 1e-12)
        share = np.clip(((start - a) * step).sum(axis=1) / size, 0.0, 1.0)
        gap = np.linalg.norm(a + share[:, None] * step - start, axis=1)
        ahead = warm[int(np.argmin(gap)) + 1 :]
    parts = (
        [start[None], ahead]
        if np.array_equal(ahead[-1], goal)
        else [start[None], ahead, goal[None]]
    )
    return np.ascontiguousarray(np.concatenate(parts))


def _extent(forest: Forest) -> str:
    """How far the search got, for the message of a failure."""
    return f"the trees have {int(forest.size[0])} and {int(forest.size[1])} nodes"


def _seed(rng: np.random.Generator) -> np.uint64:
    return np.uint64(rng.integers(0, 2**63))
