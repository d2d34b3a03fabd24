"""What ends a run by itself: something is over, or the task has failed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armsight.runtime.session import Session


class EndsWhen:
    """Ends a run when something is over, or when its task has failed for good.

    Args:
        over: asked ten times a second; None for the task's failure alone.
        why: what the session says it ended by.
    """

    name = "ending"
    period = 0.1

    def __init__(self, over: Callable[[], bool] | None = None, why: str = "done") -> None:
        self._over, self._why = over, why
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """The session to end."""
        self._session = session

    def update(self, now: float) -> None:
        """Look whether it is over."""
        if self._session is None:
            return
        if self._over is not None and self._over():
            self._session.stop(self._why)
        elif self._session.task_failure:
            self._session.stop("task failed")
