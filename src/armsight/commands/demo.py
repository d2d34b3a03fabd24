"""``armsight demo``."""

from __future__ import annotations

from dataclasses import dataclass, field

from armsight.commands.patrol import Patrol
from armsight.commands.serving import Page


@dataclass(frozen=True)
class Demo:
    """Show a guarded patrol in a simulated cell, live in the browser.

    Example: armsight demo --seconds 60

    Attributes:
        seconds: how long; until Ctrl-C if left out.
        seed: of everything random.
        page: where the live page is served.
    """

    seconds: float | None = None
    seed: int = 0
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Patrol the packaged cell."""
        from armsight.workcell.packaged import DEFAULT

        return Patrol(DEFAULT, seconds=self.seconds, seed=self.seed, page=self.page).run()
