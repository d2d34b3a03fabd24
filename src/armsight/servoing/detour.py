"""A planned way to before the target, where the law's own way is blocked.

The law leads the joints straight to its goal. Where the arm itself, the edge of what is mapped or
something that stands there is on that way, the guard keeps room to stop and the arm stands: then
the guard's planner is asked for a way to a place before the target, and the law goes on from there.
Where the target is in somebody's hand, the rest of them is beside the way: then it begins so.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.motion.data import GuardStatus
from armsight.motion.intents import PoseIntent

HELD, PACE, MOVES = 0.2, 0.2, 0.1
"""The way is blocked when in the mean over about so long [s] less than this share of the wishes is
driven, of those of at least so much [rad/s]."""
BEFORE = 0.07
"""It leads to this far before the target's surface [m]."""
TICK = 0.02
"""A word of the guard counts for this long at most [s]."""
LONGEST, GONE = 4.0, 0.06
"""It is given up after this [s], or when the target has moved by this much [m]."""
ROOM = 0.3
"""There the joints are so far from the ends of their travel [rad]: the law goes on from there, and
where a joint ends it cannot turn to its target."""
PAUSE = 1.0
"""Before the next one [s]."""


class Detour:
    """Whether one is under way, and where to.

    Args:
        name: of the goal, for the page and the log.
        first: it begins with one, as soon as a permit holds.

    Attributes:
        failed: why the planner knew none when it was asked last, in words; empty where it did.
    """

    def __init__(self, name: str, first: bool = False) -> None:
        self.name, self.first = name, first
        self.reset()

    def reset(self) -> None:
        """The way is not blocked."""
        self._share, self._told, self._began = 1.0, -math.inf, math.inf
        self._first = self.first
        self._next = -math.inf
        self._goal: PoseIntent | None = None
        self._target = np.zeros(3)
        self.failed = ""

    @property
    def going(self) -> bool:
        """Whether one is under way."""
        return self._goal is not None

    def update(
        self,
        now: float,
        guard: GuardStatus | None,
        target: Vector3,
        before: Callable[[], Pose | None],
    ) -> PoseIntent | None:
        """The goal to be driven to instead of the law's velocities, or None.

        Args:
            now: time [s].
            guard: what it did in its newest tick.
            target: (3,) where the target is [m].
            before: ``T_base_tcp`` where the tool should wait before it, if there is such a place.
        """
        if guard is None:
            return None
        if self._goal is not None:
            arrived = guard.reached and guard.goal == self.name
            self._hear(guard.reason)
            moved = float(np.linalg.norm(target - self._target)) > GONE
            if arrived or moved:
                self.failed = ""
            if arrived or moved or now > self._began + LONGEST:
                self._goal, self._share, self._next = None, 1.0, now + PAUSE
            return self._goal
        passed, self._told = min(max(guard.stamp - self._told, 0.0), TICK), guard.stamp
        self._share += (_driven(guard) - self._share) * passed / HELD
        holds = guard.permit is not None and guard.permit.holds
        if now < self._next or not (self._share <= PACE or (self._first and holds)):
            return None
        self._first = False
        place = before()
        if place is None:
            self._share, self._next = 1.0, now + PAUSE
            return None
        self._began, self._target = now, np.array(target)
        self._goal = PoseIntent(self.name, place, tolerance=0.01, tolerance_rad=0.05, room=ROOM)
        return self._goal

    def _hear(self, reason: str) -> None:
        """The guard tells of a plan that failed by the name of its goal."""
        told, word = f"goal {self.name}: ", reason.removeprefix("recovering: ")
        if word.startswith(told):
            self.failed = word.removeprefix(told).removeprefix("goal: ")


def _driven(guard: GuardStatus) -> float:
    """Share of a wish that is driven; 1 where little is wanted, or a permit is waited for.

    What goes elsewhere than the wish is none of it: where there is no room to stop the command goes
    to and fro as fast as one that gets there.
    """
    wanted = guard.wanted
    if wanted is None or guard.permit is None or not guard.permit.holds:
        return 1.0
    if float(np.abs(wanted).max()) < MOVES:
        return 1.0
    return float(np.clip(guard.command @ wanted / (wanted @ wanted), 0.0, 1.0))
