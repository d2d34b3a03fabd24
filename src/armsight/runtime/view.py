"""What the page, the recorder and the experiments may see of a running session: all read-only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.line import DeviceHealth
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.face import ShownFace
from armsight.motion.perception import SeenRobot

R = TypeVar("R")


@dataclass(frozen=True)
class ComponentHealth:
    """How a component of the loop is doing.

    Attributes:
        name: of the component; period: wanted seconds between rounds [s].
        rounds: done so far; missed: deadlines missed so far.
        last: time of the last round [s].
        seconds: (median, p99) compute time of recent rounds [s].
        problem: what is wrong, or empty.
    """

    name: str
    period: float
    rounds: int
    missed: int
    last: float
    seconds: tuple[float, float]
    problem: str = ""


@dataclass(frozen=True)
class SessionView:
    """One consistent look at a session.

    Attributes:
        now: the clock [s]; running: not paused; speed: simulated seconds a second, wanted.
        joints: newest reading.
        snapshot: newest map; guard: newest guard status.
        frames: newest frame of each camera.
        devices: of every device behind a driver.
        readings: newest of every other kind: arm status, wrench, gripper, stereo pairs.
        health: of every component.
        face: what the task shows of itself; None without a task, or one that shows nothing.
        movers: people and things that move, where a driver can show them.
        bodies: what people look like in detail, where a driver knows; they are among the movers
            as well, roughly.
        robots: arms that no driver announces.
    """

    now: float
    running: bool
    speed: float
    joints: JointState | None
    snapshot: WorkspaceSnapshot | None
    guard: GuardStatus | None
    frames: tuple[RgbdFrame, ...] = ()
    readings: tuple[Any, ...] = ()
    devices: tuple[DeviceHealth, ...] = ()
    health: tuple[ComponentHealth, ...] = ()
    face: ShownFace | None = None
    movers: tuple[MovingSolid, ...] = field(default=())
    bodies: tuple[MovingSurfaces, ...] = field(default=())
    robots: tuple[SeenRobot, ...] = field(default=())

    def reading(self, kind: type[R]) -> R | None:
        """The newest reading of a type, or None."""
        return next((r for r in self.readings if isinstance(r, kind)), None)
