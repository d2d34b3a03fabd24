"""What a task is, and all that it sees: one observation in, one intent out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from armsight.devices.data import ArmStatus, GripperState, JointState, StereoFrame, Wrench
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.intents import Intent
from armsight.motion.perception import CameraUse, Evidence, PosedFrame
from armsight.robots.robot import Robot

E = TypeVar("E", bound=Evidence)


@dataclass(frozen=True)
class Subscriptions:
    """What a task wants in its observations besides joints, wrench, gripper and the guard's word.

    Attributes:
        cameras: whose newest frames; colour as asked for there.
        stereo: names of the stereo pairs whose newest pictures; pairs take none that nobody wants.
        perceivers: names of those whose newest observations it wants; each new one starts a round
            of the task at once, besides its period.
        snapshot: the map; each new one starts a round at once, too.
    """

    cameras: tuple[CameraUse, ...] = ()
    stereo: tuple[str, ...] = ()
    perceivers: tuple[str, ...] = ()
    snapshot: bool = False


@dataclass(frozen=True)
class Perceived:
    """The newest observation of one perceiver: by whom, and what."""

    perceiver: str
    evidence: Evidence


@dataclass(frozen=True)
class Observation:
    """Everything that a task may know in one round. All of it is read-only.

    Attributes:
        now: the time of the round [s].
        robot: the arm with its tool.
        joints: newest reading, or None before the first.
        guard: the guard's newest word: what it does, why, and what it really commanded.
        snapshot: newest map; None unless subscribed to, or before the first.
        wrench: newest reading of the force sensor in the flange's frame, or None without one.
        gripper: newest state of the gripper, or None without one.
        arm: newest word of the arm's own controller, or None from one that says nothing.
        frames: newest of each camera that was subscribed to.
        pairs: newest pictures of each stereo pair that was subscribed to.
        perceived: newest of each perceiver that was subscribed to.
    """

    now: float
    robot: Robot
    joints: JointState | None = None
    guard: GuardStatus | None = None
    snapshot: WorkspaceSnapshot | None = None
    wrench: Wrench | None = None
    gripper: GripperState | None = None
    arm: ArmStatus | None = None
    frames: tuple[PosedFrame, ...] = ()
    pairs: tuple[StereoFrame, ...] = ()
    perceived: tuple[Perceived, ...] = field(default=())

    def frame(self, camera: str) -> PosedFrame | None:
        """The newest frame of a camera, or None."""
        return next((f for f in self.frames if f.info.name == camera), None)

    def result(self, perceiver: str) -> Any:
        """The newest observation of a perceiver, or None."""
        found = (p.evidence for p in self.perceived if p.perceiver == perceiver)
        return next(found, None)

    def newest(self, kind: type[E]) -> E | None:
        """The newest observation of a type, whoever made it, or None."""
        found = [p.evidence for p in self.perceived if isinstance(p.evidence, kind)]
        return max(found, key=lambda evidence: evidence.stamp, default=None)


class Task(Protocol):
    """A job. It sees an observation and says what it wants; it never sees the arm.

    A task runs beside the guard, never in it: one that is slow makes itself late. One that raises,
    or says nothing for a while, or asks for something impossible, has the arm come to rest and the
    reason shown. Besides what is here it may have

    * ``latency``: what a round takes on the simulated clock [s]; 0.002 if it does not say;
    * ``perceivers``: a sequence of :class:`~armsight.motion.perception.Perceiver` to run with it;
    * ``warm_up()``: called once before the arm may move: what compiles does so there;
    * ``reset()``: called when a simulated cell begins anew at time 0;
    * ``face()``: a :class:`~armsight.motion.face.Face` to show, asked for 20 times a second;
    * ``press(button)``: a person pressed the button of this name on its face;
    * ``standing``: a mapping of names to solids (in ``base``) that it says stand in the cell now, a
      parked car say; looked at after every round, and believed where the cameras do not object.

    All of them are called in turn with ``update``, never at the same time.

    Attributes:
        name: for the page and the log.
        period: seconds between rounds [s].
        subscriptions: what it wants to see. Which cameras may change from round to round: pictures
            are costly, and nobody should take those that nobody looks at.
    """

    name: str
    period: float

    @property
    def subscriptions(self) -> Subscriptions:
        """What it wants to see in the next round."""
        ...

    def update(self, observation: Observation) -> Intent | None:
        """What is wanted from now on; None to rest."""
        ...


def perceivers_of(task: Task | None) -> Sequence[Any]:
    """The perceivers that a task brings along."""
    return tuple(getattr(task, "perceivers", ()))
