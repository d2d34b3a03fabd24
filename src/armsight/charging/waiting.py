"""Somebody who comes near a plug in its socket is waited for: that is no failed try."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Pose
from armsight.charging.permission import Permission
from armsight.charging.visit import Seen, State, StationOptions

WAITS = (State.INSERT, State.CHARGE, State.UNPLUG)
"""States in which a permit that is lost to somebody who came near is asked for again."""
BACKED = 0.005
"""A plug that the guard has led back so far meanwhile goes in anew [m]."""


class Waiting:
    """Whom a station waits for.

    Args:
        options: of the station.
    """

    def __init__(self, options: StationOptions) -> None:
        self._most = options.interruptions if options.mode == "ours" else 0
        self.forget()

    def forget(self) -> None:
        """A new visit: nobody has come yet."""
        self._at: Pose | None = None
        self._since, self._count = 0.0, 0

    @property
    def under_way(self) -> bool:
        """Whether somebody is waited for now."""
        return self._at is not None

    def begins(self, seen: Seen, state: State, permission: Permission, T_plug: Pose) -> bool:
        """Whether a permit that was lost is waited for, from now on or already.

        Not where the plug pressed hard: that was the port's doing; and while it goes in not more
        often than :attr:`StationOptions.interruptions`.

        Args:
            seen: newest.
            state: of the station.
            permission: of the port.
            T_plug: ``T_base_plug`` now.
        """
        if self._at is not None:
            return True
        often = state is State.INSERT and self._count >= self._most
        if state not in WAITS or not self._most or often or not permission.interrupted(seen.guard):
            return False
        self._count += state is State.INSERT
        self._at, self._since = T_plug, seen.now
        return True

    def end(self, now: float, T_plug: Pose) -> tuple[float, bool]:
        """They have gone: how long that took [s], and whether the plug was led back meanwhile."""
        assert self._at is not None
        away, self._at = (T_plug - self._at)[:3, 3], None
        return now - self._since, bool(np.linalg.norm(away) > BACKED)

    def give_up(self) -> None:
        """Something else has come up: nobody is waited for any more."""
        self._at = None
