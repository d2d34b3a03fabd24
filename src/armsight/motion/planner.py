"""The predictive planner: RRT-Connect on proven edges, many solutions, the cheapest is improved."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.cost import ALPHA, danger_of
from armsight.motion.cost_kernels import CostScratch, Danger, make_cost_scratch, path_cost_kernel
from armsight.motion.data import PlanRequest
from armsight.motion.kernels import Obstacles, edge_free, path_free
from armsight.motion.plan import Plan, failed, refusal
from armsight.motion.planner_kernels import (
    FULL,
    SOLVED,
    Forest,
    improve,
    make_forest,
    plant,
    rrt_connect,
    traced,
)
from armsight.motion.timing import time_parameterise
from armsight.robots.robot import JointLimits, Robot


@dataclass(frozen=True)
class PlannerConfig:
    """How the planner works.

    Attributes:
        step: longest edge of the trees [rad].
        nodes: most nodes of a tree before it is planted anew.
        solutions: paths wanted before the cheapest is improved.
        improvement: time for more solutions and improvement after the first [s].
        looks_per_second: body poses that count as one second. Budgets are kept in this unit, so
            that a plan depends on the seed and not on the machine's load.
        wall_limit: also stop at this many times the asked time on the wall clock; None for never
            (simulations that must repeat bit for bit).
        alpha: decay of danger [1/s].
        speed, acceleration: share of the robot's limits (T2: 50 % and 60 %).
    """

    step: float = 2.0
    nodes: int = 20_000
    solutions: int = 6
    improvement: float = 0.02
    looks_per_second: float = 1.0e6
    wall_limit: float | None = None
    alpha: float = ALPHA
    speed: float = 0.5
    acceleration: float = 0.6


class RrtConnectPlanner:
    """Plans for one robot; not to be shared by threads."""

    def __init__(
        self,
        robot: Robot,
        model: CollisionModel | None = None,
        config: PlannerConfig | None = None,
        limits: JointLimits | None = None,
    ) -> None:
        self.robot = robot
        self.model = model or CollisionModel(robot)
        self.config = config or PlannerConfig()
        self.limits = limits or robot.limits.scaled(self.config.speed, self.config.acceleration)
        self._forest: Forest = make_forest(self.config.nodes, robot.n)
        self._cost: CostScratch = make_cost_scratch(self.model.body)

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`."""
        began = time.perf_counter()
        start = np.array(request.start, float)
        goal = np.array(request.goal.position, float)
        failure = refusal(self.model, start, goal, snapshot)
        if failure:
            return failed(request, snapshot, self.robot.n, failure, time.perf_counter() - began)
        ob = self.model.obstacles(snapshot, start)
        danger = danger_of(snapshot, self.config.alpha)
        first, spent = self._search(ob, start, goal, request.warm, time_limit, rng, began)
        if first is None:
            failure = f"no path found within {time_limit:g} s"
            return failed(request, snapshot, self.robot.n, failure, time.perf_counter() - began)
        found = time.perf_counter()
        left = max(0.0, time_limit - spent / self.config.looks_per_second)
        path, cost, count = self._cheapest(
            ob, danger, first, min(self.config.improvement, left), rng
        )
        motion = time_parameterise(
            path, self.limits, lambda t: self.model.first_blocked_time(t, snapshot, at=start)
        )
        return Plan(
            request.sequence,
            path,
            motion,
            cost,
            snapshot.sequence,
            found - began,
            time.perf_counter() - found,
            "",
            count,
        )

    def _search(
        self,
        ob: Obstacles,
        start: JointVector,
        goal: JointVector,
        warm: JointPath | None,
        time_limit: float,
        rng: np.random.Generator,
        began: float,
    ) -> tuple[JointPath | None, int]:
        """First path, and looks spent."""
        scratch = self.model.scratch()
        body = self.model.body
        scratch.looks[0] = 0
        straight = np.stack([start, goal])
        if warm is not None and len(warm):
            bent = np.concatenate([start[None], np.asarray(warm, float), goal[None]])
            if path_free(body, ob, bent, scratch) < 0:
                return bent, int(scratch.looks[0])
        if edge_free(body, ob, start, goal, scratch):
            return straight, int(scratch.looks[0])
        path = self._one(ob, start, goal, int(time_limit * self.config.looks_per_second), rng)
        return path, int(scratch.looks[0])

    def _one(
        self,
        ob: Obstacles,
        start: JointVector,
        goal: JointVector,
        budget: int,
        rng: np.random.Generator,
    ) -> JointPath | None:
        """A path by RRT-Connect, or None when the looks are spent."""
        body, scratch, forest = self.model.body, self.model.scratch(), self._forest
        low = np.maximum(body.lower, np.minimum(start, goal) - np.pi)
        high = np.minimum(body.upper, np.maximum(start, goal) + np.pi)
        forest.box[0], forest.box[1] = low, high
        end = int(scratch.looks[0]) + budget
        fresh = True
        while scratch.looks[0] < end:
            if fresh:
                plant(forest, start, goal, _seed(rng))
            chunk = min(20_000, end - int(scratch.looks[0]))
            outcome = rrt_connect(body, ob, forest, self.config.step, chunk, scratch)
            if outcome == SOLVED:
                return traced(forest)
            fresh = outcome == FULL
        return None

    def _cheapest(
        self,
        ob: Obstacles,
        danger: Danger,
        first: JointPath,
        seconds: float,
        rng: np.random.Generator,
    ) -> tuple[JointPath, float, int]:
        """The cheapest of several paths, improved; its cost; how many were found."""
        body, scratch, cost = self.model.body, self.model.scratch(), self._cost
        budget = int(seconds * self.config.looks_per_second)
        scratch.looks[0] = 0
        cost.looks[0] = 0
        paths = [first]
        if len(first) > 2 or not danger.calm:
            while len(paths) < self.config.solutions and scratch.looks[0] < budget // 4:
                other = self._one(ob, first[0], first[-1], budget // 4 - int(scratch.looks[0]), rng)
                if other is None:
                    break
                paths.append(other)
        share = (budget - int(scratch.looks[0])) // (2 * len(paths))
        better = [
            improve(body, ob, danger, p, _seed(rng), max(share // 2, 1), scratch, cost)
            for p in paths
        ]
        costs = [float(path_cost_kernel(body, danger, p, cost)) for p in better]
        best = better[int(np.argmin(costs))]
        left = budget - int(scratch.looks[0]) - int(cost.looks[0])
        if left > 0:
            best = improve(body, ob, danger, best, _seed(rng), left, scratch, cost)
        return best, float(path_cost_kernel(body, danger, best, cost)), len(paths)


def _seed(rng: np.random.Generator) -> np.uint64:
    return np.uint64(rng.integers(0, 2**63))
