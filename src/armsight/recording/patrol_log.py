"""Watches a patrol and keeps its figures: goals, distances, stops, and the simulation's truth."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.errors import UsageError
from armsight.motion.data import GuardMode

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import Cell


class PatrolLog:
    """An observer of a session.

    Args:
        cell: watched; with a simulation behind it, the truth is told as well.
        task: whose goals are counted.

    Attributes:
        map_seconds: compute time of each map update [s].
        trace: (time [s], distance seen by the guard [m], speed scale) at each look.
        reasons: why the guard slowed, stopped or fled, and in how many looks.
    """

    name = "patrol_log"
    period = 0.05

    def __init__(self, cell: Cell, task: PatrolTask) -> None:
        self._cell, self._task = cell, task
        self._session: Session | None = None
        self._snapshot = -1
        self._modes: Counter[GuardMode] = Counter()
        self._distance = math.inf
        self._replans = self._reflexes = 0
        self._truth_told: tuple[int | None, float] | None = None
        self.map_seconds: list[float] = []
        self.trace: list[tuple[float, float, float]] = []
        self.reasons: Counter[str] = Counter()

    def attach(self, session: Session) -> None:
        """Called by the session that is watched."""
        self._session = session

    def update(self, now: float) -> None:
        """Look at the newest status and snapshot."""
        assert self._session is not None
        guard, snapshot = self._session.status(), self._session.snapshot()
        if guard is not None:
            self._modes[guard.mode] += 1
            self._distance = min(self._distance, guard.distance)
            self.trace.append((now, min(guard.distance, 3.0), guard.speed_scale))
            self._replans, self._reflexes = guard.replans, guard.reflexes
            if guard.reason:
                self.reasons[kind(guard.reason)] += 1
        if snapshot is not None and snapshot.sequence != self._snapshot:
            self._snapshot = snapshot.sequence
            self.map_seconds.append(sum(seconds for _, seconds in snapshot.timings))

    @property
    def goals_reached(self) -> int:
        """Goals reached so far."""
        return len(self._task.times)

    @property
    def contacts(self) -> int | None:
        """True contacts while the arm moved faster than 0.05 m/s; None without a simulation.

        People and things that move count, the table too; a slower arm counts as standing.
        """
        return self._told()[0]

    @property
    def min_distance(self) -> float:
        """Least true distance of the arm to a person [m]; inf with nobody near."""
        return self._told()[1]

    @property
    def map_ms_p99(self) -> float:
        """99th percentile of the map's compute time [ms]."""
        return float(np.percentile(self.map_seconds, 99) * 1e3) if self.map_seconds else math.nan

    def share(self, *modes: GuardMode) -> float:
        """Share of the time in these modes, 0..1."""
        return sum(self._modes[m] for m in modes) / max(1, sum(self._modes.values()))

    def summary(self, session: Session) -> dict[str, Any]:
        """The run's figures as JSON knows them: what cannot be said is null."""
        return {
            "workcell": self._cell.workcell.name,
            "seed": session.seed,
            "seconds": round(session.now(), 3),
            "ended_by": session.ended_by,
            "contacts": self.contacts,
            "min_distance_m": _finite(self.min_distance),
            "goals_reached": self.goals_reached,
            "goal_times_s": [round(t, 3) for t in self._task.times],
            "realtime_factor": _finite(session.realtime_factor),
            "map_ms_p99": _finite(self.map_ms_p99),
            "min_distance_seen_m": _finite(self._distance),
            "share_slowed": round(self.share(GuardMode.SLOWED), 4),
            "share_stopped": round(self.share(GuardMode.STOPPED), 4),
            "share_reflex": round(self.share(GuardMode.REFLEX), 4),
            "replans": self._replans,
            "reflexes": self._reflexes,
            "reasons": dict(self.reasons.most_common(8)),
        }

    def lines(self, session: Session) -> list[str]:
        """The figures for a person."""
        figures = self.summary(session)
        slowed, stopped = figures["share_slowed"], figures["share_stopped"]
        lines = [
            f"{figures['seconds']:.1f} s on the cell's clock, "
            f"{figures['realtime_factor'] or 0.0:.1f} times life",
            f"goals reached     {figures['goals_reached']}",
            f"slowed, stopped   {100 * slowed:.0f} %, {100 * stopped:.0f} % of the time; "
            f"{figures['reflexes']} reflexes",
        ]
        if self.reasons:
            common = [reason for reason, _ in self.reasons.most_common(3)]
            lines.append(f"mostly because    {', '.join(common)}")
        if figures["contacts"] is not None:
            nearest = figures["min_distance_m"]
            lines.append(
                f"contacts          {figures['contacts']}"
                + (f"; nearest to a person {nearest:.3f} m" if nearest is not None else "")
            )
        return lines

    @property
    def times(self) -> list[float]:
        """When each goal was reached [s]."""
        return self._task.times

    def freeze(self) -> None:
        """Keep the truth as it is now; the cell may be closed afterwards."""
        self._truth_told = self._told()

    def _told(self) -> tuple[int | None, float]:
        """True contacts and least distance."""
        if self._truth_told is not None:
            return self._truth_told
        from armsight.workcell import simulated_world

        try:
            truth = simulated_world(self._cell).truth
        except UsageError:  # real or recorded: nobody knows
            return None, math.inf
        return len(truth.moving_contacts), float(truth.min_distance)


def kind(reason: str) -> str:
    """What a reason begins with, up to its figures, so that equal ones count together."""
    return re.split(r"\s+[(\d]", reason, maxsplit=1)[0][:80]


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None
