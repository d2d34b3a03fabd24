"""What the guard says of a tick, for tasks, the page and recordings."""

from __future__ import annotations

import math
import time

import numpy as np

from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.executed import Executed
from armsight.motion.faults import Verdict
from armsight.motion.goals import Goals
from armsight.motion.permit_office import PermitOffice
from armsight.motion.reflex import Reflex
from armsight.motion.route import Route
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter
from armsight.motion.wishes import Wishes


class StatusWriter:
    """Gathers a status from the parts of one guard."""

    def __init__(
        self,
        filter_: VelocityFilter,
        goals: Goals,
        wishes: Wishes,
        executed: Executed,
        reflex: Reflex,
        permits: PermitOffice,
    ) -> None:
        self._filter, self._goals, self._wishes = filter_, goals, wishes
        self._executed, self._reflex, self._permits = executed, reflex, permits

    def of(self, tick: Tick, route: Route | None, began: float) -> GuardStatus:
        """The status of a tick in which ``route`` was followed, if any.

        Args:
            tick: with what was decided.
            route: that the plan or the reflex follows.
            began: of the tick on the performance counter [s].
        """
        monitor, hazards, view = self._filter.monitor, self._filter.hazards, tick.near
        pair = monitor.body.pair(view, hazards, view.closest)
        return GuardStatus(
            stamp=tick.now,
            mode=tick.mode,
            reason=tick.reason,
            goal=self._wishes.name,
            reached=self._goals.reached,
            command=tick.command,
            speed_scale=float(tick.scale),
            distance=view.least,
            protective_distance=monitor.protective_distance(view, tick.here, hazards),
            nearest_hazard=None if pair is None else pair[1],
            nearest_body=None if pair is None else pair[0],
            path=None if route is None else route.remaining,
            executed=self._executed.path,
            snapshot_sequence=-1 if tick.snapshot is None else tick.snapshot.sequence,
            snapshot_age=tick.verdict.age,
            replans=self._goals.replans,
            reflexes=self._reflex.count,
            wanted=tick.wanted,
            evidence_age=self._wishes.evidence_age(tick.now),
            permit=self._permits.permit,
            timings=(("guard_step", time.perf_counter() - began),),
        )

    def blind(self, now: float, verdict: Verdict, began: float) -> GuardStatus:
        """The status where the arm's own state or time cannot be trusted."""
        return GuardStatus(
            stamp=now,
            mode=GuardMode.STOPPED,
            reason=verdict.reason,
            goal=self._wishes.name,
            reached=self._goals.reached,
            command=np.zeros(self._filter.robot.n),
            speed_scale=0.0,
            distance=math.inf,
            protective_distance=0.0,
            nearest_hazard=None,
            nearest_body=None,
            path=None,
            executed=self._executed.path,
            snapshot_sequence=-1 if verdict.snapshot is None else verdict.snapshot.sequence,
            snapshot_age=verdict.age,
            replans=self._goals.replans,
            reflexes=self._reflex.count,
            evidence_age=self._wishes.evidence_age(now),
            permit=self._permits.permit,
            timings=(("guard_step", time.perf_counter() - began),),
        )
