"""The planner's answer, and what every planner back end is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Plan:
    """A path and its motion, or why there is none.

    Attributes:
        request: sequence of the request it answers.
        path: (k, n) waypoints [rad], from the start to the goal; (0, n) on failure.
        trajectory: the motion along it within the limits, proven free; None on failure.
        cost: C_traj of the path [m] (:mod:`armsight.motion.cost`); inf on failure.
        snapshot_sequence: the snapshot that it was planned and proven against.
        planning_s: until the first path was found [s].
        optimisation_s: spent on better paths and on the motion in time [s].
        failure: why there is no path, in words; empty when all is well.
        solutions: paths found before the cheapest was chosen.
        escape_s: how long the motion first leaves something that the arm touches at its start [s];
            up to this time it is not proven free (it cannot be), only never to touch more.
    """

    request: int
    path: JointPath
    trajectory: Trajectory | None
    cost: float
    snapshot_sequence: int
    planning_s: float
    optimisation_s: float
    failure: str = ""
    solutions: int = 0
    escape_s: float = 0.0

    @property
    def good(self) -> bool:
        """Whether there is a motion to execute."""
        return not self.failure


class Planner(Protocol):
    """Finds motions. Knows no thread and no clock."""

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """Answer a request within about ``time_limit`` [s]; never raises for what it was asked."""
        ...


def refusal(
    model: CollisionModel, start: JointVector, goal: JointVector, snapshot: WorkspaceSnapshot
) -> str:
    """Why a start or a goal cannot be, in words; empty when both can."""
    for name, q in (("start", start), ("goal", goal)):
        if q.shape != (model.robot.n,):
            return f"{name}: has {q.size} joint positions, {model.robot.name} has {model.robot.n}"
    contact = model.contact(start, snapshot, at=start)
    if contact:
        return f"start: {contact}"
    contact = model.contact(goal, snapshot, at=start)
    return f"goal: {contact}" if contact else ""


def failed(
    request: PlanRequest, snapshot: WorkspaceSnapshot, n: int, reason: str, seconds: float
) -> Plan:
    """The answer that there is no path."""
    return Plan(
        request.sequence,
        np.zeros((0, n)),
        None,
        float("inf"),
        snapshot.sequence,
        seconds,
        0.0,
        reason,
    )
