"""How the visits of a station went."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from armsight.charging.visit import Outcome


class VisitLog:
    """Keeps the outcomes.

    Attributes:
        outcome: of the visit that is under way, or of the newest.
        ended: of all that have ended.
    """

    def __init__(self) -> None:
        self.outcome = Outcome()
        self.ended: list[Outcome] = []

    def begin(self, outcome: Outcome) -> None:
        """Another visit."""
        self.outcome = outcome

    def note(self, **known: Any) -> None:
        """What has become known of it, by the names of :class:`Outcome`."""
        self.outcome = replace(self.outcome, **known)

    def blame(self, problem: str) -> None:
        """What went wrong: the first thing that did is what the visit ends with."""
        self.note(problem=self.outcome.problem or problem)

    def end(self, now: float) -> None:
        """It has ended at a time [s]."""
        self.note(ended=now)
        self.ended.append(self.outcome)
