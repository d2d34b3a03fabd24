"""Which goal is pursued, which plan was asked for it, and what to say when none is found."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.geometry.pose import angle_between
from armsight.motion.data import PlanRequest
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import JointIntent, PoseIntent, refusal
from armsight.motion.plan import Plan
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot

STARTS_HERE = 0.02
"""A plan may begin this far from where the arm rests [rad]."""
Goal: TypeAlias = JointIntent | PoseIntent
"""Where a planned motion leads."""
ANSWER_TIME = 3.0
"""A request that nobody answered is repeated after this time [s]."""


class Goals:
    """The goal, its plan requests, and why it cannot be reached now.

    Attributes:
        goal: pursued now, or None.
        reached: the present goal has been reached.
        refusal: why the present goal is not pursued at all; empty when it is.
        trouble: why the last plan failed or was refused; empty when it was good.
        replans: good plans taken so far.
        held: how long the arm has stood on its way to the present goal [s].
    """

    def __init__(self, robot: Robot, config: GuardConfig) -> None:
        self._robot = robot
        self._config = config
        self.goal: Goal | None = None
        self.reached = False
        self.refusal = ""
        self.trouble = ""
        self.replans = 0
        self.held = 0.0
        self._sequence = -1
        self._pending: PlanRequest | None = None
        self._asked = -math.inf
        self._again = -math.inf
        self._seen = -1

    def set(self, goal: Goal | None) -> bool:
        """Take over what the task wants; true if it is another goal than before."""
        known = self.goal
        if goal is None:
            self.goal, self.reached, self.refusal, self.trouble = None, False, "", ""
            self._pending = None
            return known is not None
        if known is not None and (goal is known or _same(goal, known)):
            if not _as_fast(goal, known):  # the same way, slower or faster from now on
                self.goal, self.refusal = goal, refusal(goal, self._robot)
            return False
        self.goal, self.reached, self.trouble, self.held = goal, False, "", 0.0
        self.refusal = refusal(goal, self._robot)
        self._pending = None
        self._again = -math.inf
        return True

    @property
    def active(self) -> bool:
        """Whether there is a goal that is pursued and not reached yet."""
        return self.goal is not None and not self.refusal and not self.reached

    @property
    def waiting(self) -> bool:
        """Whether an answer is awaited."""
        return self._pending is not None

    def is_at(self, q: JointVector) -> bool:
        """Whether (n,) positions are within the goal's tolerance."""
        goal = self.goal
        if goal is None:
            return False
        if isinstance(goal, JointIntent):
            return bool(np.abs(q - goal.position).max() <= goal.tolerance)
        return not self._pose_miss(goal, q)

    def ask(self, now: float, start: JointVector, warm: JointPath | None) -> PlanRequest | None:
        """A request for a plan from (n,) [rad], if it is time for one."""
        if not self.active or self.goal is None:
            return None
        if self._pending is not None and now - self._asked < ANSWER_TIME:
            return None
        if now < self._again:
            return None
        self._sequence += 1
        self._asked = now
        here = np.array(start, float)
        self._pending = PlanRequest(self._sequence, here, self.goal, warm, self.held)
        return self._pending

    def answer(self, now: float, plan: Plan | None, at: JointVector) -> Plan | None:
        """The plan if it is the awaited answer and can be driven from (n,) [rad], else None."""
        pending = self._pending
        if plan is None or pending is None or plan.request != pending.sequence:
            return None
        self._pending = None
        fault = self._fault(plan, at)
        if fault:
            self.trouble = fault
            self._again = now + self._config.retry
            return None
        self.trouble = ""
        self.replans += 1
        return plan

    def drop_request(self) -> None:
        """The awaited answer would no longer fit."""
        self._pending = None

    def forget_times(self) -> None:
        """The clock jumped: when something was asked says nothing any more."""
        self._asked = self._again = -math.inf
        self._pending = None

    def _fault(self, plan: Plan, at: JointVector) -> str:
        assert self.goal is not None
        name = self.goal.name
        if plan.failure:
            return f"goal {name}: {plan.failure}"
        if plan.trajectory is None or len(plan.path) == 0:
            return f"goal {name}: the plan has no motion"
        ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration]))
        if not np.isfinite(ends).all():
            return f"goal {name}: the plan is not finite"
        gap = float(np.abs(ends[0] - at).max())
        if gap > STARTS_HERE:
            return f"goal {name}: the plan starts {gap:.3f} rad from where the arm is"
        if isinstance(self.goal, PoseIntent):
            miss = self._pose_miss(self.goal, ends[1])
            return f"goal {name}: the plan ends {miss} from the goal" if miss else ""
        away = float(np.abs(ends[1] - self.goal.position).max())
        if away > max(self.goal.tolerance, 1e-6):
            return f"goal {name}: the plan ends {away:.3f} rad from the goal"
        return ""

    def _pose_miss(self, goal: PoseIntent, q: JointVector) -> str:
        """By how much the TCP misses a pose at (n,) [rad], in words; empty within tolerance."""
        T, wanted = tcp_pose(self._robot, q), np.asarray(goal.T_base_tcp, float)
        away = float(np.linalg.norm(T[:3, 3] - wanted[:3, 3]))
        turned = angle_between(T, wanted)
        if away <= goal.tolerance and turned <= goal.tolerance_rad:
            return ""
        return f"{1e3 * away:.1f} mm, {turned:.3f} rad"


def _as_fast(a: Goal, b: Goal) -> bool:
    """Whether two goals ask for the same speed; of what is no number nobody knows."""
    try:
        return bool(a.speed == b.speed)
    except (TypeError, ValueError):
        return False


def _same(a: Goal, b: Goal) -> bool:
    """Whether two goals lead as closely to the same place under the same name."""
    if type(a) is not type(b) or a.name != b.name:
        return False
    p, q = ((g.position if isinstance(g, JointIntent) else g.T_base_tcp) for g in (a, b))
    near, nearer = (
        (g.tolerance, g.tolerance_rad if isinstance(g, PoseIntent) else 0.0) for g in (a, b)
    )
    try:
        return all(
            np.array_equal(np.asarray(x, float), np.asarray(y, float), equal_nan=True)
            for x, y in ((p, q), (near, nearer))
        )
    except (TypeError, ValueError):  # no numbers: refused when it came, and still the same wish
        return p is q
