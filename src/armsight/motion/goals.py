"""Which goal is pursued, which plan was asked for it, and what to say when none is found."""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.motion.data import JointGoal, PlanRequest
from armsight.motion.guard_config import GuardConfig
from armsight.motion.plan import Plan
from armsight.robots.robot import Robot

STARTS_HERE = 0.02
"""A plan may begin this far from where the arm rests [rad]."""
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
        self.goal: JointGoal | None = None
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

    def set(self, goal: JointGoal | None) -> bool:
        """Take over what the task wants; true if it is another goal than before."""
        known = self.goal
        if goal is None:
            self.goal, self.reached, self.refusal, self.trouble = None, False, "", ""
            self._pending = None
            return known is not None
        if known is not None and (
            goal is known
            or (
                goal.name == known.name
                and np.array_equal(goal.position, known.position, equal_nan=True)
            )
        ):
            return False
        self.goal, self.reached, self.trouble, self.held = goal, False, "", 0.0
        self.refusal = self._judge(goal)
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
        return goal is not None and bool(np.abs(q - goal.position).max() <= goal.tolerance)

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

    def _judge(self, goal: JointGoal) -> str:
        q = np.asarray(goal.position, float)
        limits, n = self._robot.limits, self._robot.n
        if q.shape != (n,):
            return f"goal {goal.name} has {q.size} joints; {self._robot.name} has {n}"
        if not np.isfinite(q).all():
            return f"goal {goal.name} is not finite: give {n} numbers in rad"
        if not 0.0 < goal.speed <= 1.0:
            return f"goal {goal.name} asks for speed {goal.speed}; expected above 0, at most 1"
        outside = np.maximum(limits.lower - q, q - limits.upper)
        if outside.max() > 0.0:
            j = int(np.argmax(outside))
            return (
                f"goal {goal.name}: {self._robot.joint_names[j]} at {q[j]:.3f} rad is outside its "
                f"limits {limits.lower[j]:.3f}..{limits.upper[j]:.3f}"
            )
        return ""

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
        miss = float(np.abs(ends[1] - self.goal.position).max())
        if miss > max(self.goal.tolerance, 1e-6):
            return f"goal {name}: the plan ends {miss:.3f} rad from the goal"
        return ""
