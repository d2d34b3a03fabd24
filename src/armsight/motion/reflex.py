"""T2's reflex: when something has come too close, go back the way it came, else away, else hold."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum

import numpy as np

from armsight.arrays import JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.executed import Executed, thinned
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards
from armsight.motion.route import Route
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.motion.timing import time_parameterise
from armsight.robots.robot import JointLimits

MEMORY = 0.35
"""Distances of the last seconds from which the approach is estimated [s]."""
SHORTEST = 0.03
"""A way back shorter than this is none [rad]."""
GAIN = 0.01
"""The way back must end at least this much farther from the nearest hazard [m]."""
NEARER = 0.02
"""By this much something must be nearer than when the reflex gave up to be fled from again [m]."""
FLEE = 0.25
"""Speed at which the nearest part would leave, before separation scales it [m/s]."""


class ReflexStage(StrEnum):
    """What the reflex is doing."""

    NONE = "none"
    STOPPING = "stopping"  # the planned motion comes to rest first
    RETRACE = "retrace"
    FLEE = "flee"
    HOLD = "hold"


class Approach:
    """How fast the nearest hazard comes nearer, from the distances at successive snapshots."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()

    def clear(self) -> None:
        """Forget what was seen."""
        self._seen.clear()

    def add(self, stamp: float, distance: float) -> None:
        """The nearest hazard was at a distance [m] at a time [s]."""
        if not math.isfinite(distance):
            self._seen.clear()
            return
        self._seen.append((stamp, distance))
        while self._seen[0][0] < stamp - MEMORY:
            self._seen.popleft()

    @property
    def speed(self) -> float:
        """Speed [m/s] at which it comes nearer; negative when it leaves; 0 if not known yet.

        A least-squares slope: one voxel that flickers moves the distance by 2 cm, which between
        two frames alone would look like half a metre a second.
        """
        if len(self._seen) < 4 or self._seen[-1][0] - self._seen[0][0] < 0.5 * MEMORY:
            return 0.0
        t, d = np.array(self._seen).T
        t = t - t.mean()
        return float(-(t @ d) / (t @ t))


class Reflex:
    """Decides when to leave, and how. The guard drives what it says."""

    def __init__(self, config: GuardConfig, limits: JointLimits) -> None:
        self._config = config
        self._limits = limits
        self.stage = ReflexStage.NONE
        self.route: Route | None = None
        self.approach = Approach()
        self.count = 0
        self._began_at = math.inf
        self._clear_since = math.inf
        self._still_since = math.inf
        self._given_up_at = math.inf

    @property
    def active(self) -> bool:
        """Whether a reflex is under way."""
        return self.stage != ReflexStage.NONE

    def end(self) -> None:
        """The reflex is over."""
        self.stage, self.route = ReflexStage.NONE, None
        self._clear_since = math.inf

    def due(self, distance: float) -> bool:
        """Whether to leave: too close, or coming too fast by the paper's rule.

        Not from what the reflex found no way to leave, unless that is nearer now.
        """
        if distance >= self._config.reflex_distance + self._config.release:
            self._given_up_at = math.inf
        if distance < min(self._config.reflex_distance, self._given_up_at - NEARER):
            return True
        speed = self.approach.speed
        return speed > 0.0 and self._config.risk.reflexive(speed, distance)

    def begin(self, distance: float) -> None:
        """Leave the plan."""
        self.stage = ReflexStage.STOPPING
        self.count += 1
        self._began_at = distance
        self._clear_since = self._still_since = math.inf

    def choose(
        self,
        q: JointVector,
        executed: Executed,
        gate: SeparationMonitor,
        hazards: Hazards,
        model: CollisionModel,
        snapshot: WorkspaceSnapshot,
    ) -> None:
        """At rest at (n,) [rad]: retrace if that is proven free and leads away, else flee."""
        back = thinned(executed.retrace(q, self._config.retrace_share))
        if self._leads_away(back, q, gate, hazards) and model.path_valid(back, snapshot, q):
            self.stage = ReflexStage.RETRACE
            motion = time_parameterise(
                back, self._limits, lambda t: model.first_blocked_time(t, snapshot, at=q)
            )
            self.route = Route(motion)
        else:
            self.stage = ReflexStage.FLEE

    def hold(self) -> None:
        """There is no proven way to leave."""
        self.stage, self.route = ReflexStage.HOLD, None

    def stuck(self, now: float, at_rest: bool) -> bool:
        """Whether the arm has stood for as long as patience lasts; looks at every tick."""
        if not at_rest:
            self._still_since = math.inf
        elif math.isinf(self._still_since):
            self._still_since = now
        return now - self._still_since >= self._config.patience

    def try_other(self, distance: float) -> None:
        """What was tried does not move the arm: leave instead of going back, or give up.

        Whoever stands still beside the arm, and unseen space there, would otherwise hold it in the
        reflex for ever. Given up, a plan may lead it out; separation limits every part of that.
        """
        self._still_since = math.inf
        if self.stage == ReflexStage.RETRACE:
            self.stage, self.route = ReflexStage.FLEE, None
        elif self.approach.speed <= 0.0:
            self._given_up_at = distance
            self.end()

    def over(self, now: float, distance: float) -> bool:
        """Whether the danger has passed for long enough; looks at every tick."""
        far = distance >= self._config.reflex_distance + self._config.release
        apart = distance >= self._began_at + self._config.release
        calm = (far or apart) and not self.due(distance)
        if not calm:
            self._clear_since = math.inf
        elif math.isinf(self._clear_since):
            self._clear_since = now
        return now - self._clear_since >= self._config.recovery

    def _leads_away(
        self, back: JointPath, q: JointVector, gate: SeparationMonitor, hazards: Hazards
    ) -> bool:
        if len(back) < 2 or np.abs(np.diff(back, axis=0)).sum() < SHORTEST:
            return False
        still = np.zeros_like(q)
        here = gate.body.view(q, still, hazards, gate.law).least
        there = gate.body.view(back[-1], still, hazards, gate.law).least
        return there >= here + GAIN
