"""What tasks ask of the guard, and what the guard says of itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from armsight.arrays import JointPath, JointVector, Vector3


@dataclass(frozen=True)
class JointGoal:
    """Bring the joints to a configuration.

    Attributes:
        name: for the page and the log, such as ``A``.
        position: (n,) [rad].
        tolerance: reached when every joint is this close [rad].
        speed: share of the cell's allowed speed, 0..1.
    """

    name: str
    position: JointVector
    tolerance: float = 0.01
    speed: float = 1.0


class GuardMode(StrEnum):
    """What the guard is doing."""

    IDLE = "idle"  # no goal
    PLANNING = "planning"  # holds still until a path is ready
    PREDICTIVE = "predictive"  # follows a planned path at full allowed speed
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
    timings: tuple[tuple[str, float], ...] = field(default=())


class Task(Protocol):
    """A job. It asks the guard for goals and never sees the arm."""

    name: str

    def update(self, now: float, status: GuardStatus | None) -> JointGoal | None:
        """The goal to pursue now, or None to rest; called once a guard tick, must be quick."""
        ...


@dataclass(frozen=True)
class PlanRequest:
    """Asks the planner for a path. The guard writes it, the planner answers the newest.

    Attributes:
        sequence: counts requests; the answer carries it.
        start: (n,) [rad] where the arm will be at rest when the plan begins.
        goal: where to.
        warm: (k, n) a path that was good a moment ago, or None.
        held: how long the arm has stood on its way to this goal [s].
    """

    sequence: int
    start: JointVector
    goal: JointGoal
    warm: JointPath | None = None
    held: float = 0.0
