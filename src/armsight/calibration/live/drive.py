"""Carrying a procedure out: by something that moves the arm and something that photographs."""

from __future__ import annotations

from typing import Protocol

from armsight.arrays import JointVector
from armsight.calibration.live.procedure import Procedure
from armsight.calibration.live.result import LiveResult
from armsight.calibration.live.seen import Looked, MoveTo, Picture


class Mover(Protocol):
    """What moves the arm: the guard in a running cell, a driver of its own in a simulation."""

    def move(self, joints: JointVector) -> bool:
        """Bring the arm to rest there; False if it cannot or may not."""
        ...

    def joints(self) -> JointVector:
        """(n,) where the arm says it is [rad]."""
        ...

    def now(self) -> float:
        """The cell's time [s]."""
        ...


class Eyes(Protocol):
    """What takes the pictures."""

    def look(self, cameras: tuple[int, ...], rest: float, frames: int) -> list[Picture]:
        """Wait until the arm has rested, and photograph with some cameras."""
        ...


def drive(steps: Procedure, mover: Mover, eyes: Eyes) -> LiveResult:
    """Carry a procedure out."""
    reply: bool | Looked | None = None
    try:
        while True:
            request = steps.send(reply) if reply is not None else next(steps)
            if isinstance(request, MoveTo):
                reply = mover.move(request.joints)
            else:
                pictures = eyes.look(request.cameras, request.rest, request.frames)
                reply = Looked(mover.joints(), pictures)
    except StopIteration as end:
        result: LiveResult = end.value
        return result
