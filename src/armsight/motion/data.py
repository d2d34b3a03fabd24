"""What the guard says of itself, and what it asks of the planner."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

from armsight.arrays import JointPath, JointVector, Vector3
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.intents import JointIntent, PoseIntent
from armsight.motion.permits import Permit
from armsight.motion.permitted import Grant, permitted


class GuardMode(StrEnum):
    """What the guard is doing."""

    IDLE = "idle"  # no goal
    PLANNING = "planning"  # holds still until a path is ready
    PREDICTIVE = "predictive"  # follows a planned path at full allowed speed
    VELOCITY = "velocity"  # moves as a task's velocity says
    SLOWED = "slowed"  # follows it, scaled down by separation
    STOPPED = "stopped"  # holds: someone is too close, or data is late; see the reason
    REFLEX = "reflex"  # retraces or flees


@dataclass(frozen=True)
class GuardStatus:
    """One tick of the guard, for tasks, the page, recordings and experiments.

    Attributes:
        stamp: time of the tick [s].
        mode: what it is doing.
        reason: why it is slowed, stopped or in reflex, in words; empty in free motion.
        goal: name of the goal, or empty.
        reached: the goal with this name is reached.
        command: (n,) joint velocities really sent [rad/s].
        speed_scale: share of the planned speed in use, 0..1.
        distance: least distance of any part of the body to the nearest hazard [m]; inf if none.
        protective_distance: what separation demands at the present speed [m].
        nearest_hazard, nearest_body: (3,) the two points of ``distance`` in ``base``, or None.
        path: (k, n) waypoints still to be driven, or None.
        executed: (k, n) waypoints driven since the goal was set, thinned.
        snapshot_sequence: the snapshot this tick looked at; -1 before the first.
        snapshot_age: age of its stalest camera at the tick [s].
        replans: plans made so far; reflexes: reflexes started so far.
        wanted: (n,) joint velocities that a velocity intent asks for [rad/s]; None without one.
        evidence_age: of the velocity intent at the tick [s]; NaN without one.
        permit: what became of the contact that was asked for; None when none is.
        timings: (stage, seconds).
    """

    stamp: float
    mode: GuardMode
    reason: str
    goal: str
    reached: bool
    command: JointVector
    speed_scale: float
    distance: float
    protective_distance: float
    nearest_hazard: Vector3 | None
    nearest_body: Vector3 | None
    path: JointPath | None
    executed: JointPath | None
    snapshot_sequence: int
    snapshot_age: float
    replans: int = 0
    reflexes: int = 0
    wanted: JointVector | None = None
    evidence_age: float = math.nan
    permit: Permit | None = None
    timings: tuple[tuple[str, float], ...] = field(default=())


@dataclass(frozen=True)
class PlanRequest:
    """Asks the planner for a path. The guard writes it, the planner answers the newest.

    Attributes:
        sequence: counts requests; the answer carries it.
        start: (n,) [rad] where the arm will be at rest when the plan begins.
        goal: where to: joint positions, or a pose of the TCP.
        warm: (k, n) a path that was good a moment ago, or None.
        held: how long the arm has stood on its way to this goal [s].
        grant: what may be touched, or None.
    """

    sequence: int
    start: JointVector
    goal: JointIntent | PoseIntent
    warm: JointPath | None = None
    held: float = 0.0
    grant: Grant | None = None

    def surroundings(self, snapshot: WorkspaceSnapshot) -> WorkspaceSnapshot:
        """A snapshot as the planner is to see it for this request."""
        return snapshot if self.grant is None else permitted(snapshot, self.grant)

    @property
    def target(self) -> JointVector:
        """(n,) where to [rad].

        Raises:
            TypeError: the goal is a pose, which :class:`~.PosePlanner` has to solve first.
        """
        if not isinstance(self.goal, JointIntent):
            raise TypeError(f"goal {self.goal.name} is a pose; plan to it by PosePlanner")
        return self.goal.position
