"""Plays recorded devices on the recording's clock, as a simulated world moves simulated ones.

A source yields dated deliveries in the order of time; :meth:`Playback.advance` hands them to the
devices up to a moment. Whether that moment follows a simulated or the wall clock is all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from armsight.arrays import Pose, Vector3
from armsight.devices.data import ArmStatus, DeclaredSolids, EmptyCell, JointState, RgbdFrame
from armsight.devices.recorded import (
    RecordedArm,
    RecordedCamera,
    RecordedClock,
    RecordedSensor,
)
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.errors import UsageError
from armsight.motion.data import GuardStatus
from armsight.motion.face import ShownFace
from armsight.recording.messages import to_ns, to_seconds


@dataclass(frozen=True)
class Moved:
    """Where all that moves besides the arm is now; None leaves what was said before.

    Attributes:
        movers: rough solids; bodies: people in detail.
    """

    movers: tuple[MovingSolid, ...] | None = None
    bodies: tuple[MovingSurfaces, ...] | None = None


@dataclass(frozen=True)
class Delivery:
    """What came into the session at one moment.

    Attributes:
        at: on the recording's clock [ns].
        item: a reading of a device, a tick of the guard, what moved, or a task's face.
    """

    at: int
    item: Any


@dataclass(frozen=True)
class Source:
    """Something that can be played.

    Attributes:
        name: of the file or folder.
        span: first and last moment [s].
        deliveries: starts over and yields in the order of time.
        note: what the user should know of it, such as where it was cut short.
        close: lets go of files.
        shows_task: whether a task showed something when it was recorded.
    """

    name: str
    span: tuple[float, float]
    deliveries: Callable[[], Iterator[Delivery]]
    note: str = ""
    close: Callable[[], None] = field(default=lambda: None)
    shows_task: bool = False


class Playback:
    """Moves recorded devices along; used like a simulated world.

    Attributes:
        source: what is played.
        guard: the newest recorded word of the guard, or None.
        face: what the task showed last, or None.
        note: what the user should know, such as where the recording was cut short.
        last: time of the newest delivery [s].
        on_empty: called where somebody had said that nobody is in the cell.
        on_declared: called where somebody had declared solids, or withdrawn them.
    """

    def __init__(
        self,
        source: Source,
        clock: RecordedClock,
        arm: RecordedArm,
        cameras: Sequence[RecordedCamera],
        sensors: Mapping[tuple[type, str], RecordedSensor[Any]] | None = None,
    ) -> None:
        self.source = source
        self.clock = clock
        self.arm = arm
        self.cameras = tuple(cameras)
        self.guard: GuardStatus | None = None
        self.face: ShownFace | None = None
        self.note = source.note
        self.on_empty: Callable[[], None] = lambda: None
        self.on_declared: Callable[[DeclaredSolids], None] = lambda word: None
        self.last = source.span[0]
        self._sensors = dict(sensors or {})
        self._cameras: Mapping[str, RecordedCamera] = {c.info.name: c for c in cameras}
        self._movers: tuple[MovingSolid, ...] = ()
        self._bodies: tuple[MovingSurfaces, ...] = ()
        self._rest = source.deliveries()
        self._next = next(self._rest, None)

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return self.source.span[1] - self.source.span[0]

    @property
    def finished(self) -> bool:
        """Whether everything was delivered."""
        return self._next is None

    def advance(self, until: float) -> None:
        """Deliver all that came up to a time [s] and move the clock there."""
        limit = to_ns(until)
        while self._next is not None and self._next.at <= limit:
            self._deliver(self._next.item)
            self.last = to_seconds(self._next.at)
            self._next = next(self._rest, None)
        self.clock.set(max(until, self.clock.now()))

    def reset(self) -> None:
        """Back to the start."""
        self._rest = self.source.deliveries()
        self._next = next(self._rest, None)
        self.guard, self.face, self._movers, self._bodies = None, None, (), ()
        self.arm.deliver(None)
        for camera in self.cameras:
            camera.deliver(None)
        for sensor in self._sensors.values():
            sensor.deliver(None)
        self.clock.set(self.source.span[0])

    def movers(self) -> tuple[MovingSolid, ...]:
        """People and things that moved, as the recording's simulation knew them."""
        return self._movers

    def bodies(self) -> tuple[MovingSurfaces, ...]:
        """What people looked like, as the recording's simulation knew it."""
        return self._bodies

    def drag(self, name: str, position_world: Vector3) -> None:
        """What is recorded cannot be moved.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{name} is part of a recording and cannot be dragged")

    def camera_error(self, name: str, T_believed_corrected: Pose, gain: float) -> float | None:
        """A recording does not know the truth."""
        return None

    def close(self) -> None:
        """Let go of the file."""
        self.source.close()

    def _deliver(self, item: Any) -> None:
        if isinstance(item, RgbdFrame):
            self._cameras[item.camera].deliver(item)
        elif isinstance(item, JointState):
            self.arm.deliver(item)
        elif isinstance(item, ArmStatus):
            self.arm.deliver_status(item)
        elif isinstance(item, EmptyCell):
            self.on_empty()
        elif isinstance(item, DeclaredSolids):
            self.on_declared(item)
        elif isinstance(item, GuardStatus):
            self.guard = item
        elif isinstance(item, ShownFace):
            self.face = item
        elif isinstance(item, Moved):
            self._movers = self._movers if item.movers is None else item.movers
            self._bodies = self._bodies if item.bodies is None else item.bodies
        else:
            sensor = self._sensors.get((type(item), getattr(item, "camera", "")))
            if sensor is not None:
                sensor.deliver(item)
