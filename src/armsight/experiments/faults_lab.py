"""The drivers of :mod:`.wall_lab` with a fault that somebody else lets begin, and a guard with one.

When it began lies in shared memory: the programs that are killed do not know.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from armsight.devices.port import ArmSettings, CameraSettings
from armsight.experiments import wall_lab
from armsight.experiments.faults_devices import Trouble, TroubledArm, TroubledCamera
from armsight.experiments.faults_parts import STALL, TroubledTime
from armsight.runtime.components import Guards
from armsight.runtime.shared_block import SharedBlock

SIZE = 8
"""Bytes of the memory in which the beginning lies."""


class HostClock:
    """The computer's."""

    @staticmethod
    def now() -> float:
        """``time.perf_counter()`` [s]."""
        return time.perf_counter()


class SharedTrouble(Trouble):
    """What goes wrong, since a moment that another process writes down.

    Args:
        block: the memory; about: ``case``, ``jump``, ``joint``, ``sign``.
    """

    def __init__(self, block: SharedBlock, about: Mapping[str, Any]) -> None:
        super().__init__(
            str(about["case"]), float(about["jump"]), int(about["joint"]), float(about["sign"])
        )
        self._block = block

    def at(self, now: float) -> bool:
        """Whether it has begun; ``now`` may be of any clock."""
        (since,) = struct.unpack_from("d", self._block.memory)
        if since:
            self.begin, self.end = min(self.begin, now), math.inf
        return bool(since)


def set_trouble(block: SharedBlock, begin: float) -> None:
    """Write down when it began [s of the computer's clock]; 0 for not at all."""
    struct.pack_into("d", block.memory, 0, begin)


def trouble_of(connection: Mapping[str, Any]) -> SharedTrouble:
    """The one that a driver's connection names."""
    return SharedTrouble(SharedBlock(str(connection["trouble"])), connection)


class Arm(TroubledArm):
    """The lab's arm, and what goes wrong with it."""

    def __init__(self, settings: ArmSettings) -> None:
        super().__init__(wall_lab.Arm(settings), HostClock, trouble_of(settings.connection))


class Camera(TroubledCamera):
    """A camera of the lab, and what goes wrong with its clock."""

    def __init__(self, settings: CameraSettings) -> None:
        super().__init__(wall_lab.Camera(settings), HostClock, trouble_of(settings.connection))


class LateGuard:
    """A guard one of whose ticks is late by :data:`.STALL`.

    Args:
        inner: the true one; trouble: when.
    """

    def __init__(self, inner: Guards, trouble: Trouble) -> None:
        self._inner, self._trouble = inner, trouble
        self._done = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def step(self, now: float, *rest: Any) -> Any:
        """A tick."""
        if not self._done and self._trouble.at(now):
            self._done = True
            time.sleep(STALL)
        return self._inner.step(now, *rest)


@dataclass(frozen=True)
class GuardElsewhere:
    """Makes a guard in the process of the command path, with what goes wrong there.

    Attributes:
        make: a true one; about: see :class:`SharedTrouble`; ``trouble`` names the memory.
    """

    make: Callable[[], Guards]
    about: dict[str, Any]

    def __call__(self) -> Guards:
        """It, warmed up."""
        true = self.make()
        trouble = trouble_of(self.about)
        if trouble.name == "late":
            return LateGuard(true, trouble)
        return TroubledTime(true, trouble) if trouble.name.startswith("clock_") else true
