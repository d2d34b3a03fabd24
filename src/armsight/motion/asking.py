"""A permit that was withdrawn is asked for again after a round without it."""

from __future__ import annotations

from armsight.motion.data import GuardStatus
from armsight.motion.permits import PermitState


class AskAnew:
    """Whether to ask in this round: a guard that withdrew a permit wants the question anew."""

    def __init__(self) -> None:
        self._pausing = False

    def may_ask(self, guard: GuardStatus | None) -> bool:
        """One round.

        Args:
            guard: its newest word; None where there is none yet.
        """
        permit = None if guard is None else guard.permit
        lost = permit is not None and permit.state is PermitState.WITHDRAWN
        self._pausing = lost and not self._pausing
        return not self._pausing
