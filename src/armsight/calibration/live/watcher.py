"""Who is told how a procedure goes: the page, the terminal, the file of views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.seen import SeenView


@dataclass(frozen=True)
class Progress:
    """Where the procedure stands, for the page and the terminal.

    Attributes:
        stage: in words; views: taken; seen: (L,) boards seen by each lens.
        expected: (L,) expected target error [m], NaN before the first solve.
        answer: the present estimate, once there is one.
    """

    stage: str
    views: int
    seen: tuple[int, ...]
    expected: tuple[float, ...]
    answer: Calibration | None = None


class Watcher(Protocol):
    """Told of everything that happens."""

    def stage(self, progress: Progress) -> None:
        """A step of the procedure."""
        ...

    def view(self, view: SeenView) -> None:
        """A view was taken: write it down, so that a stopped calibration can go on."""
        ...


class Silent:
    """Watches nothing."""

    def stage(self, progress: Progress) -> None:
        """Ignore."""

    def view(self, view: SeenView) -> None:
        """Ignore."""
