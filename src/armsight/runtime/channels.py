"""What the components of a session hand each other: slots, a box of frames, joint history."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from armsight.arrays import Floats
from armsight.devices.data import JointState, RgbdFrame, StereoFrame, Wrench
from armsight.devices.history import JointHistory
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus, PlanRequest
from armsight.motion.face import ShownFace
from armsight.motion.intents import Intent, Rest
from armsight.motion.perception import SeenRobot
from armsight.runtime.posing import NewestFrames
from armsight.runtime.slot import Slot

if TYPE_CHECKING:
    from armsight.motion.plan import Plan

R = TypeVar("R")


class SharedJointHistory(JointHistory):
    """A joint history that one thread fills while another asks."""

    def __init__(self, seconds: float = 2.0) -> None:
        super().__init__(seconds)
        self._lock = threading.Lock()

    def add(self, state: JointState) -> None:
        """Remember a reading."""
        with self._lock:
            super().add(state)

    def feel(self, wrench: Wrench) -> None:
        """Remember a reading of the force sensor."""
        with self._lock:
            super().feel(wrench)

    def felt(self, stamp: float) -> Floats | None:
        """(6,) what the force sensor said about a time [s]; see :meth:`JointHistory.felt`."""
        with self._lock:
            return super().felt(stamp)

    def copy(self) -> JointHistory:
        """The readings so far."""
        with self._lock:
            return super().copy()

    @property
    def latest(self) -> JointState | None:
        """The newest reading, or None."""
        with self._lock:
            return super().latest

    def at(self, stamp: float, tolerance: float = 0.05) -> JointState | None:
        """Joints at a time [s]; see :meth:`JointHistory.at`."""
        with self._lock:
            return super().at(stamp, tolerance)


class FrameBox:
    """Frames on their way to the map; the oldest is dropped when nobody takes them.

    Attributes:
        dropped: frames that nobody took; readers: who else gets every frame.
    """

    def __init__(self, capacity: int = 16) -> None:
        self._lock = threading.Lock()
        self._waiting: deque[RgbdFrame] = deque(maxlen=capacity)
        self._newest: dict[str, RgbdFrame] = {}
        self.dropped = 0
        self.readers: list[NewestFrames] = []

    def show(self, frame: RgbdFrame | StereoFrame) -> None:
        """A frame for those who look; pairs are nothing to the map."""
        for box in self.readers:
            box.put(frame)

    def put(self, frame: RgbdFrame, for_map: bool = True) -> None:
        """Leave a frame, for the map and for whoever looks, or for those alone."""
        self.show(frame)
        with self._lock:
            self._newest[frame.camera] = frame
            if for_map:
                self.dropped += len(self._waiting) == self._waiting.maxlen
                self._waiting.append(frame)

    def take(self) -> list[RgbdFrame]:
        """All waiting frames, oldest first; they are gone from the box."""
        with self._lock:
            frames = list(self._waiting)
            self._waiting.clear()
            return frames

    def newest(self) -> tuple[RgbdFrame, ...]:
        """The newest frame of each camera, by name."""
        with self._lock:
            return tuple(self._newest[name] for name in sorted(self._newest))


class Readings:
    """The newest reading of every kind besides joints and depth: wrench, gripper, arm status ..."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest: dict[tuple[type, str], Any] = {}
        self._wrenches: deque[Wrench] = deque(maxlen=1024)

    def put(self, reading: Any) -> None:
        """Replace the newest of its type, and of its camera where it has one."""
        with self._lock:
            if isinstance(reading, Wrench):
                self._wrenches.append(reading)
            self._newest[type(reading), getattr(reading, "camera", "")] = reading

    def take_wrenches(self) -> list[Wrench]:
        """Every reading of the force sensor since the last call, oldest first."""
        with self._lock:
            taken = list(self._wrenches)
            self._wrenches.clear()
            return taken

    def newest(self, kind: type[R], camera: str = "") -> R | None:
        """The newest of a type (and of a camera, for pictures), or None."""
        with self._lock:
            found: R | None = self._newest.get((kind, camera))
            return found

    def all(self) -> tuple[Any, ...]:
        """The newest of every kind."""
        with self._lock:
            return tuple(self._newest.values())


@dataclass(frozen=True)
class TaskWord:
    """What a task said last.

    Attributes:
        stamp: time of the round in which it was said [s].
        intent: what it wants; fault: what is wrong with the task, in words, or empty.
    """

    stamp: float
    intent: Intent | None
    fault: str = ""


def pursued(word: TaskWord | None, now: float, name: str, silent_after: float) -> Intent | None:
    """What the guard is to pursue at ``now`` [s]: a task's word, or rest with the reason.

    Args:
        word: its newest, or None before the first.
        now: time [s].
        name: of the task, for the reason.
        silent_after: when a word has become too old to be taken [s].
    """
    if word is None:
        return None
    if word.fault:
        return Rest(word.fault, fault=True)
    age = now - word.stamp
    if age > silent_after:
        return Rest(f"task {name} has said nothing for {age:.2f} s", fault=True)
    return word.intent


class Channels:
    """All that flows between the components of one session."""

    def __init__(self) -> None:
        self.history = SharedJointHistory()
        self.frames = FrameBox()
        self.readings = Readings()
        self.joints: Slot[JointState] = Slot()
        self.snapshot: Slot[WorkspaceSnapshot] = Slot()
        self.request: Slot[PlanRequest] = Slot()
        self.plan: Slot[Plan] = Slot()
        self.status: Slot[GuardStatus] = Slot()
        self.word: Slot[TaskWord] = Slot()
        self.face: Slot[ShownFace] = Slot()
        self.robots: Slot[tuple[SeenRobot, ...]] = Slot()
