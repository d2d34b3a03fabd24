"""What a session and the process of its command path say to each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armsight.devices.data import ArmStatus, JointState, Wrench
from armsight.devices.driven_arm import ArmRecipe
from armsight.devices.line import DeviceHealth
from armsight.motion.data import GuardStatus, PlanRequest
from armsight.runtime.channels import TaskWord
from armsight.runtime.components import Guards
from armsight.runtime.snapshot_memory import Ticket
from armsight.runtime.view import ComponentHealth

if TYPE_CHECKING:
    from armsight.motion.plan import Plan


@dataclass(frozen=True)
class Times:
    """What the session's clock said [s], and ``time.perf_counter()`` at that moment."""

    now: float
    host: float


# --- from the session ------------------------------------------------------------------------


@dataclass(frozen=True)
class Open:
    """Open the arm; answered by :class:`Opened`."""

    arm: ArmRecipe
    times: Times


@dataclass(frozen=True)
class Begin:
    """Make a guard; answered by :class:`Ready`.

    Attributes:
        make: returns it, warmed up.
        sensing_period, guard_period: [s].
        task: its name; silent_after: see :func:`armsight.runtime.channels.pursued`.
    """

    make: Callable[[], Guards]
    sensing_period: float
    guard_period: float
    task: str
    silent_after: float


@dataclass(frozen=True)
class Run:
    """Let it command the arm until :class:`End`; answered by :class:`Ended`."""

    times: Times


@dataclass(frozen=True)
class End:
    """Let it command no more, and stop the arm."""


@dataclass(frozen=True)
class Halt:
    """Tell the arm to stop, now; answered by :class:`Halted` with the same number."""

    number: int


@dataclass(frozen=True)
class News:
    """What the guard looks at; whatever is None has not changed.

    Attributes:
        held: see :class:`~armsight.runtime.components.GuardComponent`.
        wrenches: every reading since the last news.
        ticket: of a newer map.
    """

    held: bool
    word: TaskWord | None = None
    plan: Plan | None = None
    wrenches: tuple[Wrench, ...] = ()
    ticket: Ticket | None = None


@dataclass(frozen=True)
class Close:
    """Let go of the arm, and end; answered by :class:`Closed`."""


# --- to the session --------------------------------------------------------------------------


@dataclass(frozen=True)
class Opened:
    """The arm is open, or why not."""

    problem: str = ""


@dataclass(frozen=True)
class Ready:
    """The guard is made, or why not."""

    problem: str = ""


@dataclass(frozen=True)
class Halted:
    """The arm was told to stop, or why it could not be told."""

    number: int
    problem: str = ""


@dataclass(frozen=True)
class Ended:
    """The guard commands no more, the arm was told to stop; why, if that was not asked for."""

    problem: str = ""


@dataclass(frozen=True)
class Closed:
    """The arm was let go of, or what went wrong."""

    problem: str = ""


@dataclass(frozen=True)
class State:
    """How it is; whatever is None has not changed.

    Attributes:
        joints, arm: newest of the arm; arm_problem: why there is nothing newer, or empty.
        lost: the arm is lost for good.
        status, request: newest of the guard; problem: its, in words.
        health: of the guard's rounds; device: of the arm.
        priority: with which the guard runs, in words.
    """

    joints: JointState | None
    arm: ArmStatus | None
    arm_problem: str = ""
    lost: bool = False
    status: GuardStatus | None = None
    request: PlanRequest | None = None
    problem: str = ""
    health: ComponentHealth | None = None
    device: DeviceHealth | None = None
    priority: str = ""
