"""OMPL as a second back end: another opinion for tests, the reference for costs, a peer for speed.

What to know of the Python wheel (2.0.1), each measured:

* a validity call from Python costs about a microsecond: with our compiled checks that is fine, and
  a ``MotionValidator`` written in Python is honoured, so edges are proven here as well;
* an objective's ``stateCost`` is ignored when overridden in Python, ``motionCost`` is not;
* ``AORRTC`` fails on trivial questions and ``BITstar`` crashes when its setup is used twice: one
  fresh setup is made a question;
* the seed is global: seeds are set before each question, so a question repeats in a process of its
  own and when questions are asked in the same order, one thread at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.danger import ALPHA
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.cost import danger_of
from armsight.motion.cost_kernels import edge_cost, path_cost_kernel
from armsight.motion.data import PlanRequest
from armsight.motion.kernels import config_free, edge_free, make_scratch
from armsight.motion.plan import Plan, failed, refusal
from armsight.motion.timing import time_parameterise
from armsight.robots.robot import JointLimits, Robot

Algorithm = Literal["RRTConnect", "RRTstar", "InformedRRTstar", "BITstar", "PRMstar"]
OPTIMISING = ("RRTstar", "InformedRRTstar", "BITstar", "PRMstar")
"""Algorithms that go on improving until the time is over."""


class OmplPlanner:
    """Plans with OMPL for one robot behind the same protocol; not to be shared by threads.

    Args:
        robot: the arm.
        algorithm: OMPL's name; the optimising ones use the whole time limit and minimise C_traj.
        model: collision checks; made from the robot when None.
        alpha: decay of danger [1/s].
        limits: of the motion in time; 50 % speed and 60 % acceleration when None (T2).
        simplify: let OMPL shorten the path of an algorithm that does not optimise.
        clock: what the time limit and a plan's seconds are measured by [s]; ``time.thread_time``
            where other programs would disturb a measurement.
    """

    def __init__(
        self,
        robot: Robot,
        algorithm: Algorithm = "RRTConnect",
        model: CollisionModel | None = None,
        alpha: float = ALPHA,
        limits: JointLimits | None = None,
        simplify: bool = True,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.robot = robot
        self.algorithm = algorithm
        self.model = model or CollisionModel(robot)
        self.alpha = alpha
        self.limits = limits or robot.limits.scaled(0.5, 0.6)
        self.simplify = simplify
        self._clock = clock

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`; ``warm`` is not used."""
        began = self._clock()
        start = np.array(request.start, float)
        goal = np.array(request.target, float)
        reason = refusal(self.model, start, goal, snapshot)
        if reason:
            return failed(request, snapshot, self.robot.n, reason, self._clock() - began)
        path = self._path(start, goal, snapshot, time_limit, int(rng.integers(1, 2**31)))
        found = self._clock()
        if path is None:
            reason = f"no path found within {time_limit:g} s"
            return failed(request, snapshot, self.robot.n, reason, found - began)
        blocked = self.model.first_blocked(path, snapshot, at=start)
        if blocked is not None:
            reason = f"OMPL's path is blocked at its segment {blocked}"
            return failed(request, snapshot, self.robot.n, reason, found - began)
        motion = time_parameterise(
            path, self.limits, lambda t: self.model.first_blocked_time(t, snapshot, at=start)
        )
        body = self.model.body
        danger = danger_of(snapshot, self.alpha)
        cost = float(path_cost_kernel(body, danger, path, make_scratch(body)))
        optimisation = self._clock() - found
        return Plan(
            request.sequence,
            path,
            motion,
            cost,
            snapshot.sequence,
            found - began,
            optimisation,
            "",
            1,
        )

    def _path(
        self,
        start: JointVector,
        goal: JointVector,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        seed: int,
    ) -> JointPath | None:
        from ompl import base, geometric, util

        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(seed)
        n = self.robot.n
        space = base.RealVectorStateSpace(n)
        bounds = base.RealVectorBounds(n)
        body = self.model.body
        low = np.maximum(body.lower, np.minimum(start, goal) - np.pi)
        high = np.minimum(body.upper, np.maximum(start, goal) + np.pi)
        for j in range(n):
            bounds.setLow(j, float(low[j]))
            bounds.setHigh(j, float(high[j]))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        info = setup.getSpaceInformation()

        ob = self.model.obstacles(snapshot, start)
        scratch = self.model.scratch()
        q0, q1 = np.empty(n), np.empty(n)

        def read(state: Any, out: JointVector) -> JointVector:
            for j in range(n):
                out[j] = state[j]
            return out

        def valid(state: Any) -> bool:
            return bool(config_free(body, ob, read(state, q0), scratch))

        class Proof(base.MotionValidator):  # type: ignore[misc]
            def checkMotion(self, a: Any, b: Any) -> bool:
                return bool(edge_free(body, ob, read(a, q0), read(b, q1), scratch))

        proof = Proof(info)
        setup.setStateValidityChecker(valid)
        info.setMotionValidator(proof)
        objective = None
        if self.algorithm in OPTIMISING:
            danger = danger_of(snapshot, self.alpha)
            memory = make_scratch(body)

            class DangerAware(base.OptimizationObjective):  # type: ignore[misc]
                def motionCost(self, a: Any, b: Any) -> Any:
                    value = edge_cost(body, danger, read(a, q0), read(b, q1), memory)
                    return base.Cost(float(value))

                def stateCost(self, state: Any) -> Any:
                    return base.Cost(0.0)

            objective = DangerAware(info)
            setup.setOptimizationObjective(objective)
        first, last = space.allocState(), space.allocState()
        for j in range(n):
            first[j], last[j] = float(start[j]), float(goal[j])
        setup.setStartAndGoalStates(first, last)
        planner = getattr(geometric, self.algorithm)(info)
        setup.setPlanner(planner)
        end = self._clock() + time_limit
        setup.solve(base.PlannerTerminationCondition(lambda: bool(self._clock() >= end)))
        if not setup.haveExactSolutionPath():
            return None
        if self.simplify and self.algorithm not in OPTIMISING:
            setup.simplifySolution()
        states = setup.getSolutionPath().getStates()
        path = np.array([[state[j] for j in range(n)] for state in states])
        path[0], path[-1] = start, goal
        return path
