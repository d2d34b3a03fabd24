"""T2's patrol: from goal to goal and back again, resting at each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armsight.arrays import JointVector
from armsight.errors import UsageError
from armsight.motion.face import Face, Figure
from armsight.motion.intents import JointIntent
from armsight.motion.task import Observation, Subscriptions

if TYPE_CHECKING:
    from armsight.workcell import Cell


@dataclass(frozen=True)
class PatrolOptions:
    """Visit the cell's goals ([patrol.goals_deg]) in turn, again and again.

    Attributes:
        dwell: rest at each goal [s]; the cell's own if left out.
        goal_speed: share of the allowed speed, above 0 to 1.
    """

    dwell: float | None = None
    goal_speed: float = 1.0

    def make(self, cell: Cell) -> PatrolTask:
        """The patrol of a cell."""
        patrol = cell.workcell.patrol
        dwell = patrol.dwell_s if self.dwell is None else self.dwell
        return PatrolTask(cell.workcell.goals, dwell, self.goal_speed)


class PatrolTask:
    """Visits named goals in order, again and again (A-B-A with two).

    Args:
        goals: (n,) joint positions by name [rad], visited in this order.
        dwell: rest at each goal [s].
        speed: share of the allowed speed, 0..1.
        tolerance: reached when every joint is this close [rad].

    Attributes:
        visits: goals reached so far; times: when each was reached [s].

    Raises:
        UsageError: fewer than two goals.
    """

    name = "patrol"
    period = 0.008
    latency = 0.0  # it computes nothing
    subscriptions = Subscriptions(snapshot=True)  # a new map starts a round here as in the guard

    def __init__(
        self,
        goals: Mapping[str, JointVector],
        dwell: float = 0.5,
        speed: float = 1.0,
        tolerance: float = 0.01,
    ) -> None:
        if len(goals) < 2:
            raise UsageError(
                f"a patrol needs at least two goals, found {len(goals)}; "
                "name them in the workcell file under [patrol.goals_deg]"
            )
        self._goals = [JointIntent(name, q, tolerance, speed) for name, q in goals.items()]
        self._dwell = dwell
        self.reset()

    def reset(self) -> None:
        """Back to the first goal, nothing visited."""
        self.visits = 0
        self.times: list[float] = []
        self._arrived = math.inf

    @property
    def goal(self) -> JointIntent:
        """The goal pursued now."""
        return self._goals[self.visits % len(self._goals)]

    def update(self, observation: Observation) -> JointIntent:
        """The goal to pursue now; the next one once the arm has rested at this one."""
        now, guard, here = observation.now, observation.guard, self.goal
        if guard is not None and guard.goal == here.name and guard.reached:
            if math.isinf(self._arrived):
                self._arrived = now
                self.times.append(now)
            if now - self._arrived >= self._dwell:
                self.visits += 1
                self._arrived = math.inf
        return self.goal

    def face(self) -> Face:
        """Where it is going, what it has done, and the goals it goes between."""
        n = len(self._goals)
        minutes = (self.times[-1] - self.times[0]) / 60.0 if len(self.times) > 1 else math.nan
        rate = (len(self.times) - 1) / minutes if minutes > 0.0 else math.nan
        resting = math.isfinite(self._arrived)
        names = " → ".join(intent.name for intent in self._goals)
        return Face(
            state=f"{'rests at' if resting else 'on its way to'} {self.goal.name}",
            reason=f"round {self.visits // n + 1} of {names}",
            figures=(Figure("goals reached", float(len(self.times))), Figure("a minute", rate)),
        )
