"""Plans to a pose of the TCP: of all inverse solutions the one that is there soonest wins.

The time that counts is what separation would let the arm have, not the length of the way: an elbow
that turns towards somebody loses to one that turns away (:mod:`armsight.motion.keep_out`). One that
ends close under the top of the mapped box, where the arm hides what nobody else looks at and might
not be let away again, is taken only where there is no other; and so is one that leaves a joint less
room than is asked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import PlanRequest
from armsight.motion.ik import solve_ik
from armsight.motion.intents import JointIntent, PoseIntent
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.lid import ROOM
from armsight.motion.plan import Plan, failed
from armsight.motion.trajectory import straight
from armsight.robots.robot import JointLimits, Robot

SOLUTIONS = 16
"""Inverse solutions that are looked for; a 6-axis arm has at most eight, and their whole turns."""
PLANNED = 4
"""Solutions that are planned to at most once one path is known."""
FURTHER = 0.004
"""Time limit of every plan but the first that succeeds [s]."""


class PosePlanner:
    """Wraps a planner so that goals may be poses; joint goals pass through unchanged.

    Args:
        planner: plans to joint goals, and says how long a motion would take among people.
        robot: the arm.
        limits: at which motions are planned; they bound the time of a way from below.
    """

    def __init__(self, planner: SeparationPlanner, robot: Robot, limits: JointLimits) -> None:
        self._planner = planner
        self._robot = robot
        self._limits = limits

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`."""
        goal = request.goal
        if isinstance(goal, JointIntent):
            return self._planner.plan(request, snapshot, time_limit, rng)
        candidates = self._candidates(goal, request.start, snapshot, rng)
        if not candidates:
            x, y, z = np.asarray(goal.T_base_tcp, float)[:3, 3]
            words = f"out of reach: no joints bring the TCP to ({x:.3f}, {y:.3f}, {z:.3f}) m so"
            return failed(request, snapshot, self._robot.n, words, 0.0)
        best: Plan | None = None
        first: Plan | None = None
        best_time, spent, tries = np.inf, 0.0, 0
        for last, least, q in candidates:
            if best is not None and (last or least >= best_time or tries >= PLANNED):
                break
            tries += 1
            joints = JointIntent(goal.name, q, speed=goal.speed)
            limit = time_limit if best is None else min(FURTHER, time_limit)
            found = self._planner.plan(replace(request, goal=joints), snapshot, limit, rng)
            spent += found.planning_s + found.optimisation_s
            first = first or found
            if found.trajectory is None:
                continue
            takes = self._planner.expected_time(found.trajectory, request, snapshot)
            if takes < best_time:
                best, best_time = found, takes
        answer = best or first
        assert answer is not None
        return replace(answer, optimisation_s=max(spent - answer.planning_s, 0.0))

    def _candidates(
        self,
        goal: PoseIntent,
        start: JointVector,
        snapshot: WorkspaceSnapshot,
        rng: np.random.Generator,
    ) -> list[tuple[bool, float, JointVector]]:
        """Inverse solutions: whether one is a last resort, and the least time to it [s].

        Those that end under the very top, or at the end of a joint's travel, come last, the soonest
        first.
        """
        found = solve_ik(self._robot, goal.T_base_tcp, start, rng, wanted=SOLUTIONS)
        limits = self._robot.limits
        timed = [
            (
                self._planner.lid.below_the_top(q, snapshot.grid) < ROOM
                or float(np.minimum(q - limits.lower, limits.upper - q).min()) < goal.room,
                straight(start, q, self._limits).duration,
                q,
            )
            for q in found
        ]
        return sorted(timed, key=lambda entry: entry[:2])
