"""What goes wrong with a simulated camera, for tests and experiments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armsight.simulation.lies import LieKind

FaultKind = Literal["fail", "lost", "freeze", "delay", "drop", "empty"] | LieKind


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong with a camera for a while, for tests and experiments.

    Attributes:
        kind: ``fail`` no frames; ``lost`` no frames and reading raises; ``freeze`` the same picture
            again and again with fresh stamps; ``delay`` frames arrive later by ``amount`` seconds;
            ``drop`` each frame is lost with probability ``amount``; ``empty`` no returns at all;
            lies of depth cameras: see :data:`~armsight.simulation.lies.LieKind`.
        start, end: [s].
        amount: see ``kind``.
    """

    kind: FaultKind
    start: float = 0.0
    end: float = float("inf")
    amount: float = 0.0

    def active(self, now: float) -> bool:
        """Whether it is at work at ``now`` [s]."""
        return self.start <= now < self.end


class Faults:
    """Faults of one device; they stay over a reset of the world."""

    def __init__(self) -> None:
        self._faults: list[Fault] = []

    def add(self, fault: Fault) -> None:
        """From now on this goes wrong as well."""
        self._faults.append(fault)

    def clear(self) -> None:
        """All is well again."""
        self._faults.clear()

    @property
    def memory(self) -> float | None:
        """How far back a picture may be told again [s]; None when none may."""
        return max((f.amount for f in self._faults if f.kind == "old"), default=None)

    def find(self, kind: FaultKind, now: float) -> Fault | None:
        """The active fault of a kind, the latest added first."""
        active = (f for f in reversed(self._faults) if f.kind == kind and f.active(now))
        return next(active, None)
