"""Why the tip does not come to its target, in words: out of reach, folded, or its way is blocked.

Beside the guard's own word, which says why the arm does not move now, this says what keeps it from
the target for as long as that stays where it is.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.motion.collision import CollisionModel
from armsight.motion.data import GuardStatus
from armsight.motion.ik import solve_ik
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.aim import Aim, Weights, aim_pose, joints_for
from armsight.servoing.ceiling import Ceiling

SHORT = 0.03
"""Joints that leave the tip this far from its goal do not reach it [m]."""
AT_LIMIT = 0.02
"""A joint so near to its limit is at it [rad]."""
SINGULAR = 0.03
"""Least singular value of the Jacobian below which a pose counts as singular."""
EVERY = 2.0
"""Joints for the target are looked for again after this time [s]: up to 10 ms where none are."""
STANDS, NEARER = 2.0, 0.01
"""A tip that has not come nearer by this much [m] within this time [s] is held up."""
ELSEWHERE = 0.05
"""A target that has moved by this much is another errand [m]."""
ROUNDS, STARTS = 80, 30
"""Of the search for joints: from here and from home as the law does, then from anywhere."""
OUT = "out of reach"


class Reach:
    """Whether an arm can bring its tip to an aim at all.

    Args:
        robot: the arm; weights: of position against direction, those of the law.
        ceiling: what no part may rise above; None without one.
    """

    def __init__(self, robot: Robot, weights: Weights, ceiling: Ceiling | None) -> None:
        self.robot, self.weights = robot, weights
        self.ceiling = None if ceiling is None else ceiling.above(robot)
        self._model = CollisionModel(robot)

    def fault(self, aim: Aim, joints: JointVector) -> str:
        """Why it cannot, in words; empty where it can.

        Args:
            aim: of the tip, at the end of its way.
            joints: (n,) where the arm is [rad].
        """
        q, short = self._nearest(aim, joints, self.weights, self.ceiling)
        if short <= SHORT:
            gap, parts = self._model.own_gap(q)
            return "" if gap >= 0.0 else f"the arm would touch itself there: {parts}"
        words = f"{OUT}: no joints bring the tip there"
        if self.ceiling is not None:
            free, without = self._nearest(aim, joints, self.weights, None)
            if without <= SHORT and self.ceiling.under(self.robot, free) < 0.0:
                return f"{words} below the top of what is mapped"
        if solve_ik(
            self.robot, aim_pose(aim), joints, np.random.default_rng(0), wanted=1, starts=STARTS
        ):
            return ""  # the law does not find the way there; the planner may
        loose = replace(self.weights, axis=1e-3, roll=1e-3)
        if self._nearest(aim, joints, loose, self.ceiling)[1] <= SHORT:
            return f"{words} with the tool pointing as it has to{self._limits(q)}"
        return words + self._limits(q)

    def _nearest(
        self, aim: Aim, joints: JointVector, weights: Weights, ceiling: Ceiling | None
    ) -> tuple[JointVector, float]:
        """(n,) joints from here or from home, and how far their tip is from the aim [m]."""
        best, least = joints, math.inf
        for start in (joints, np.asarray(self.robot.home, float)):
            q = joints_for(self.robot, aim, start, weights, ROUNDS, ceiling=ceiling)
            away = float(np.linalg.norm(tcp_pose(self.robot, q)[:3, 3] - aim.position))
            if away < least:
                best, least = q, away
            if least <= SHORT:
                break
        return best, least

    def _limits(self, q: JointVector) -> str:
        """Which joints are at a limit there."""
        lower, upper = self.robot.limits.lower, self.robot.limits.upper
        said = [
            f"{name} at its limit of {math.degrees(end):.0f} deg"
            for name, at, low, high in zip(self.robot.joint_names, q, lower, upper)
            for end in (low, high)
            if abs(at - end) < AT_LIMIT
        ]
        return f" ({', '.join(said)})" if said else ""


class Hindrance:
    """What holds the tip up on its way to a target, judged round by round.

    Args:
        reach: of the arm.

    Attributes:
        words: why, newest; empty while nothing does.
    """

    def __init__(self, reach: Reach) -> None:
        self.reach = reach
        self.reset()

    def reset(self) -> None:
        """Nothing does."""
        self.words = ""
        self._place: Vector3 | None = None
        self._best, self._since = math.inf, math.inf
        self._asked, self._fault = -math.inf, ""

    def update(
        self,
        now: float,
        left: float,
        aim: Aim | None,
        joints: JointVector,
        guard: GuardStatus | None,
        may: bool,
        blocked: str = "",
    ) -> str:
        """Why it does not come nearer, in words; empty while it does, or is there.

        Args:
            now: time [s].
            left: of the tip's way to its goal before, or on, the target [m].
            aim: of the tip at the end of it; None without a target.
            joints: (n,) [rad].
            guard: what it did in its newest tick.
            may: it may be there: without a permit it is the guard's own word that says why not.
            blocked: why the guard's planner found no way, if it was asked.
        """
        if aim is None or left <= SHORT:
            self.reset()
            return ""
        if self._place is None or np.linalg.norm(aim.position - self._place) > ELSEWHERE:
            self._place, self._best, self._since = aim.position.copy(), left, now
        if left < self._best - NEARER:
            self._best, self._since = left, now
        if now > self._asked + EVERY:
            self._asked, self._fault = now, self.reach.fault(aim, joints)
        self.words = self._fault if self._fault.startswith(OUT) else ""
        if not self.words and may and now > self._since + STANDS:
            self.words = self._fault or self._held_up(joints, guard, blocked)
        return self.words

    def _held_up(self, joints: JointVector, guard: GuardStatus | None, blocked: str) -> str:
        """By what, of an arm that could be there."""
        said = []
        if blocked:
            said.append(f"no way around what is before it: {blocked}")
        elif guard is not None and guard.reason:
            said.append(guard.reason)
        least = float(np.linalg.svd(tcp_jacobian(self.reach.robot, joints), compute_uv=False)[-1])
        if least < SINGULAR:
            said.append("the arm is near a singular pose")
        return "held up on its way: " + ("; ".join(said) or "it does not come nearer")
