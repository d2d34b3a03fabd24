"""Map, guard's time, loop and disk that go wrong while a cell runs."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.devices.data import RgbdFrame
from armsight.devices.history import JointHistory
from armsight.experiments.faults_devices import Trouble
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.runtime.parts import MakeParts, Parts, make_parts
from armsight.runtime.renewed_map import RenewedMap

if TYPE_CHECKING:
    from armsight.runtime.config import SessionConfig
    from armsight.workcell import Cell

BITE = 64 * 1024 * 1024
"""A map that eats memory takes so much at a time [bytes] ..."""
ROOM = 2 * BITE
"""... of so much that there is [bytes]."""
STALL = 0.3
"""A loop that stands does so for so long [s]."""


class TroubledMap:
    """A map that raises, does not return, or eats memory; as long as the trouble lasts.

    A simulated clock stands while a map hangs. So without ``hang`` one that hangs takes the
    pictures and hands out what it had before: nothing new comes from it.

    Args:
        inner: the true one; trouble: what goes wrong; hang: does not return.
    """

    def __init__(
        self, inner: Any, trouble: Trouble, hang: Callable[[], None] | None = None
    ) -> None:
        self._inner, self._trouble, self._hang = inner, trouble, hang
        self._before: WorkspaceSnapshot | None = None
        self._eaten: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def update(
        self, frames: Sequence[RgbdFrame], joints: JointHistory, now: float, tracked: Any = None
    ) -> WorkspaceSnapshot:
        """A round, or what is left of it."""
        if self._trouble.at(now) and (frames or self._trouble.name == "map_hangs"):
            if self._trouble.name == "map_raises":
                raise ValueError("operands could not be broadcast together")
            if self._trouble.name == "map_hangs" and self._hang is not None:
                self._hang()
            if self._trouble.name == "map_hangs" and self._before is not None:
                return self._before
            if self._trouble.name == "map_eats":
                with little_memory():
                    while True:
                        self._eaten.append(np.ones(BITE, np.uint8))
        snapshot: WorkspaceSnapshot = self._inner.update(frames, joints, now, tracked)
        self._before = snapshot
        return snapshot


@contextmanager
def little_memory() -> Iterator[None]:
    """This process may take :data:`ROOM` more, and the system says so when it does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


class TroubledTime:
    """A map or guard that is told another time than it is.

    Args:
        inner: the true one; trouble: what goes wrong.
    """

    def __init__(self, inner: Any, trouble: Trouble) -> None:
        self._inner, self._trouble = inner, trouble

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def _told(self, now: float) -> float:
        return now + self._trouble.jump * self._trouble.at(now)

    def update(
        self, frames: Sequence[RgbdFrame], joints: JointHistory, now: float, tracked: Any = None
    ) -> Any:
        """A round of a map."""
        return self._inner.update(frames, joints, self._told(now), tracked)

    def step(self, now: float, *rest: Any) -> Any:
        """A tick of a guard."""
        return self._inner.step(self._told(now), *rest)


def troubled_parts(trouble: Trouble) -> MakeParts:
    """Makes the parts of a session, some of which go wrong."""

    def make(cell: Cell, config: SessionConfig) -> Parts:
        parts = make_parts(cell, config)
        if trouble.name.startswith("map_"):
            assert isinstance(parts.workspace, RenewedMap)
            true = parts.workspace.make
            return replace(parts, workspace=RenewedMap(lambda: TroubledMap(true(), trouble)))
        if trouble.name.startswith("clock_"):
            return replace(
                parts,
                workspace=TroubledTime(parts.workspace, trouble),
                guard=TroubledTime(parts.guard, trouble),
            )
        return parts

    return make


class Stall:
    """An observer in whose round the whole loop stands once.

    Args:
        advance: moves the world's time on to another [s].
    """

    name, period = "stall", 0.004

    def __init__(self, trouble: Trouble, advance: Callable[[float], None]) -> None:
        self._trouble, self._advance = trouble, advance
        self._done = trouble.name != "late"

    def update(self, now: float) -> None:
        """Stand once."""
        if not self._done and self._trouble.at(now):
            self._done = True
            self._advance(now + STALL)


class FullDisk:
    """An observer that leaves the files of this process no room as long as the trouble lasts.

    Args:
        file: that is written.
    """

    name, period = "full disk", 0.004

    def __init__(self, trouble: Trouble, file: Path) -> None:
        self._trouble, self._file = trouble, file
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        self._full = False

    def update(self, now: float) -> None:
        """Take the room, or give it back."""
        full = self._trouble.name == "disk" and self._trouble.at(now)
        if full and not self._full:
            room = max(self._file.stat().st_size, 4096)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, self._limits[1]))
        if self._full and not full:
            self.close()
        self._full = full

    def close(self) -> None:
        """Give the room back."""
        resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)
