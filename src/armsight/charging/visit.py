"""What a station is told, what it wants, and how a visit ended."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from armsight.arrays import Pose
from armsight.charging.eye import PortLook
from armsight.charging.insert import InsertOptions
from armsight.charging.lid_eye import LidLook
from armsight.devices.data import JointState, Wrench
from armsight.motion.data import GuardStatus
from armsight.motion.intents import Intent


class State(StrEnum):
    """What the station is doing."""

    STAND_BY = "stand by"
    SHOW = "shows its plug"
    FIND = "find"
    LOOK = "second look"
    APPROACH = "approach"
    ALIGN = "align"
    TARE = "tare"
    INSERT = "insert"
    CHARGE = "charge"
    UNPLUG = "unplug"
    HELD = "held up"
    LEAVE = "leave"
    LID_LOOK = "looks at the lid"
    LID_BEFORE = "goes to the lid"
    LID_ALIGN = "aligns with the lid"
    LID_TARE = "tares at the lid"
    LID_WORK = "works the lid"
    LID_AWAY = "leaves the lid"
    STUCK = "stuck"


NEAR = (State.ALIGN, State.TARE, State.INSERT, State.CHARGE, State.UNPLUG, State.LEAVE)
"""States in which the plug is before the port or in it, and asks to touch it."""
IN_CONTACT = (State.INSERT, State.CHARGE, State.UNPLUG, State.LID_WORK, State.LID_AWAY)
PLUGGED = (State.CHARGE, State.UNPLUG, State.HELD)
"""States in which the plug may be in a car: one that moves then stays on the map, since a plug does
not come out where what stands beside it might be somebody. What is gone the map sees."""
AT_LID = (State.LID_BEFORE, State.LID_ALIGN, State.LID_TARE, State.LID_WORK, State.LID_AWAY)
"""States in which the finger is out."""
ASIDE, ASIDE_FINGER = 0.08, 0.10
"""Half the side of what may be touched about a port, without and with a finger beside the plug: the
guard counts with it as if it were always out [m]."""


def aside_of(T_tip_finger: Pose | None) -> float:
    """Which of them a station with this finger asks for, or with none [m]."""
    return ASIDE if T_tip_finger is None else ASIDE_FINGER


@dataclass(frozen=True)
class StationOptions:
    """How a station works.

    Attributes:
        plug: its type.
        mode: ``ours``, or ``paper``: one look, plane through the contacts, halt by force.
        insert: law of plugging in; its depth is the plug's.
        far, near: names of the standing pair and of the one on the flange (or empty).
        before: the approach ends so far before the port [m]; start: force takes over so far [m].
        look_from: distance of the second look [m]; look_aside: off the port's axis [rad].
        speed: along the port's axis while nothing is felt [m/s].
        aside: half the side of what may be touched about the port [m].
        force, torque: that the permit asks for [N], [N m].
        settle: at rest before a look and before taring [s].
        looks: of each kind at most; tries: of the whole way from the second look on.
        interruptions: of plugging in by somebody who comes near, at most; they are no tries.
        patience: for one state at most, but for charging [s]; lid_patience: for working a lid.
        lid_from: distance of the near look at a lid [m].
        far_sigma, near_sigma: of a port's place in ``base`` by each pair, beyond what the pictures
            leave open: calibration and arm [m].
        least: score of a port that is believed; least_far: by the standing pair, where the one on
            the flange looks again.
        reach: a port farther from the base is out of reach [m].
        cable: what hangs on the plug [N]; None where nobody knows: then nobody asks what it weighs.
    """

    plug: str = "type2_plug"
    mode: Literal["ours", "paper"] = "ours"
    insert: InsertOptions = field(default_factory=InsertOptions)
    far: str = "post"
    near: str = "flange"
    before: float = 0.10
    start: float = 0.015
    look_from: float = 0.36
    look_aside: float = math.radians(22.0)
    speed: float = 0.06
    aside: float = ASIDE
    force: float = 125.0
    torque: float = 15.0
    settle: float = 0.5
    looks: int = 4
    tries: int = 3
    interruptions: int = 10
    patience: float = 45.0
    lid_patience: float = 90.0
    lid_from: float = 0.40
    far_sigma: float = 0.004
    near_sigma: float = 0.002
    least: float = 0.6
    least_far: float = 0.5
    reach: float = 1.35
    cable: float | None = None


@dataclass(frozen=True, eq=False)
class Seen:
    """What the station is told in one round.

    Attributes:
        now: [s]; joints: newest; wrench: newest of the force sensor, or None.
        guard: its newest word; looks: newest of each pair; lids: likewise of a lid.
        drawn_back: how far the finger beside the plug is drawn back [m]; None without one.
    """

    now: float
    joints: JointState
    wrench: Wrench | None = None
    guard: GuardStatus | None = None
    looks: tuple[PortLook, ...] = ()
    lids: tuple[LidLook, ...] = ()
    drawn_back: float | None = None


@dataclass(frozen=True, eq=False)
class Wish:
    """What it wants.

    Attributes:
        intent: for the guard; pairs: whose pictures it needs now.
    """

    intent: Intent
    pairs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """How a visit went.

    Attributes:
        seated: fully plugged in, as far as the station can tell; charged: and the car had enough.
        out: the plug is out again.
        problem: what went wrong, in words; empty when nothing did.
        warning: what was not made sure of, in words; the visit went on.
        port: type that was found, or empty; score: of it.
        began, found, approached, plugged, ended: times [s]; NaN where it did not come to that.
        tries: of plugging in.
        lid_opened: a lid was opened; lid_shut: and shut again.
    """

    seated: bool = False
    charged: bool = False
    out: bool = True
    problem: str = ""
    warning: str = ""
    port: str = ""
    score: float = math.nan
    began: float = math.nan
    found: float = math.nan
    approached: float = math.nan
    plugged: float = math.nan
    ended: float = math.nan
    tries: int = 0
    lid_opened: bool = False
    lid_shut: bool = False
