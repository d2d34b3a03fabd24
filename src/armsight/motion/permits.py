"""Contact permits: who must touch something asks for one, and the guard answers in words.

Everything that is not declared counts as a person, and nobody is touched. A task that has to touch
(a ball, a socket, a palm) says beside its intent what, where, with which parts of the arm, and how
gently at most. The guard grants it, grants less, or refuses; it withdraws what it has granted when
the target is lost, jumps or becomes unsure, when somebody comes near it, or when it is pressed too
hard. Outside of the region nothing changes. ``docs/guard.md`` has the proof.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Real
from typing import Any, Literal, TypeAlias

import numpy as np

from armsight.arrays import Floats, Mask, Vector3
from armsight.motion.regions import Region, region_fault
from armsight.robots.robot import Robot

ContactKind: TypeAlias = Literal["thing", "hand", "face"]


@dataclass(frozen=True)
class PermitRequest:
    """Asks to touch what is in a region; carried by an intent, anew in every round of a task.

    Attributes:
        name: what is to be touched, for the page and the log. A permit that was withdrawn is not
            granted again under the same name until the task has published an intent without it.
        kind: ``thing``: nobody is in the small region; ``hand``: somebody's hand, or what it holds;
            ``face``: with a part declared soft.
        region: where, as last seen: for a thing its own outline, no margin added.
        parts: what of the arm may touch: names of links, or ``tool`` for what the flange carries.
        reach: and of those only what lies within this distance of the TCP [m].
        speed: greatest speed at contact, relative to the region [m/s].
        force: greatest force [N]; torque: greatest torque about the TCP [N m].
        stiffness: of a thing and what holds it, as the arm meets it, at most [N/m]: it bounds the
            speed from which the arm can stop before the force is reached.
        seconds: for how long from when it is granted [s].
        out: (3,) unit vector in ``base``: the one way out of a thing that holds what is in it, such
            as a socket; None where every way that leads away from it will do.
        tare: (6,) force and torque that the sensor said before anything touched, at the flange, in
            its axes [N], [N m], if the task knows: for a guard that begins with an arm in contact.
    """

    name: str
    kind: ContactKind
    region: Region
    parts: tuple[str, ...] = ("tool",)
    reach: float = math.inf
    speed: float = 0.05
    force: float = 10.0
    torque: float = 2.0
    seconds: float = 10.0
    stiffness: float = 5e3
    out: Vector3 | None = None
    tare: Floats | None = None


class PermitState(StrEnum):
    """What became of a request."""

    GRANTED = "granted"
    LESS = "granted less"
    REFUSED = "refused"
    WITHDRAWN = "withdrawn"


@dataclass(frozen=True)
class Permit:
    """The guard's answer.

    Attributes:
        name, kind: of the request.
        state: what became of it; reason: in words, empty when it was granted as asked.
        region: the newest that is believed, of one that is not granted the newest that could be;
            None without one.
        speed, force, torque: what is granted [m/s], [N], [N m].
        until: when it ends [s].
        pressed: force [N] of the arm on what it touches, by the last reading while it holds; NaN if
            nobody says.
    """

    name: str
    kind: str
    state: PermitState
    reason: str = ""
    region: Region | None = None
    speed: float = 0.0
    force: float = 0.0
    torque: float = 0.0
    until: float = -math.inf
    pressed: float = math.nan

    @property
    def holds(self) -> bool:
        """Whether the arm may touch."""
        return self.state in (PermitState.GRANTED, PermitState.LESS)

    def __str__(self) -> str:
        words = f"contact with {self.name} ({self.kind}) {self.state.value}"
        return f"{words}: {self.reason}" if self.reason else words


@dataclass(frozen=True)
class PermitLimits:
    """What may be granted of one kind at most.

    Attributes:
        extent: greatest distance between two points of the region [m].
        region_speed: of its centre when it is granted [m/s]; held_speed: while it holds.
        deviation: standard deviation of its centre [m].
        age: since its exposure [s].
        speed: of contact [m/s]; force: [N]; torque: [N m]; seconds: [s].
    """

    extent: float
    region_speed: float
    held_speed: float
    deviation: float
    age: float
    speed: float
    force: float
    torque: float
    seconds: float


LIMITS: dict[str, PermitLimits] = {
    "thing": PermitLimits(0.5, 1.0, 1.0, 0.03, 60.0, 0.25, 150.0, 20.0, 120.0),
    "hand": PermitLimits(1.2, 1.0, 1.0, 0.05, 0.5, 0.25, 140.0, 5.0, 30.0),
    "face": PermitLimits(0.45, 0.2, 0.24, 0.03, 0.5, 0.1, 5.0, 0.5, 20.0),
}
"""A thing may be pressed as hard as a plug is pushed home (85 to 125 N), a hand as hard as ISO/TS
15066 lets a hand be held, where the cell's file says so (``GuardConfig.thing_force``,
``hand_force``); a face hardly, and all that is near it no harder: before, below and behind a head
is space that no camera sees, where its own hands may be. A head sways and nods at up to 0.2 m/s,
and is met relative to its own motion. That speed is seen, some cm/s off: a permit that ended with
each look in which it seems faster would end before every turn. One camera alone, five times a
second, knows its place to 25 mm; who comes to touch it has it before a pair."""
UNFELT = 0.02
"""Speed at which a thing is touched [m/s] where no force sensor feels it."""


def request_fault(request: Any, robot: Robot, now: float) -> str:
    """Why a request cannot be granted whatever is seen, in words; empty when it may be."""
    if not isinstance(request, PermitRequest):
        return f"a task asked for {type(request).__name__}; expected a PermitRequest"
    if request.kind not in tuple(LIMITS):
        return f'its kind is "{request.kind}"; granted are {", ".join(LIMITS)}'
    fault = region_fault(request.region, now)
    if fault:
        return f"its region cannot be: {fault}"
    for name in ("speed", "force", "torque", "seconds", "reach", "stiffness"):
        value = getattr(request, name)
        if not isinstance(value, Real) or not float(value) > 0.0:
            return f"its {name} is {value}; expected above 0"
    if request.out is not None and not _is_direction(request.out):
        return f"its way out is {request.out}; expected a unit vector"
    if request.tare is not None and _numbers(request.tare, 6) is None:
        return f"its tare is {request.tare}; expected 3 forces [N] and 3 torques [N m]"
    parts: Any = request.parts
    if not isinstance(parts, tuple | list):
        return f"its parts are {parts!r}; expected names"
    known = ("tool", *robot.link_names[1:])
    wrong = [part for part in request.parts if part not in known]
    if wrong or not request.parts:
        return f"no part {', '.join(map(str, wrong)) or 'given'}; this arm has {', '.join(known)}"
    if "tool" in request.parts and robot.tool is None:
        return f"the flange carries no tool; name a link: {', '.join(known[1:])}"
    return ""


def _is_direction(value: Any) -> bool:
    way = _numbers(value, 3)
    return way is not None and abs(float(way @ way) - 1.0) < 1e-6


def _numbers(value: Any, count: int) -> Floats | None:
    """So many finite numbers, or None where it is something else."""
    try:
        numbers = np.asarray(value, float)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.shape == (count,) and np.isfinite(numbers).all() else None


def region_refusal(region: Region, kind: str, now: float, held: bool = False) -> str:
    """Why a well-formed region is not taken, in words; empty when it is.

    Args:
        region: of what is to be touched.
        kind: of permit.
        now: time [s].
        held: the permit holds already.
    """
    limits = LIMITS[kind]
    fastest = limits.held_speed if held else limits.region_speed
    if region.extent > limits.extent:
        return f"its region is {region.extent:.2f} m large; at most {limits.extent:g} m"
    if region.speed > fastest:
        return f"it moves at {region.speed:.2f} m/s; at most {fastest:g}"
    age = now - region.exposure
    if age > limits.age:
        return f"it was last seen {age:.2f} s ago"
    deviation = region.deviation(now)
    if deviation > limits.deviation:
        return (
            f"its place is known to {1e3 * deviation:.0f} mm only (seen {max(age, 0.0):.2f} s ago);"
            f" at most {1e3 * limits.deviation:.0f}"
        )
    return ""


def granted(
    request: PermitRequest, now: float, unfelt: str = "", hardest: float = math.inf
) -> Permit:
    """The answer to a request that nothing speaks against: as asked, or less.

    Args:
        request: well-formed.
        now: time [s].
        unfelt: why nobody feels how hard the arm presses; empty when a sensor does.
        hardest: greatest force that the cell allows [N].
    """
    limits = LIMITS[request.kind]
    limits = replace(limits, force=min(limits.force, hardest))
    if unfelt:
        limits = replace(limits, speed=min(limits.speed, UNFELT))
    less = [
        f"{name} {most:g} instead of {getattr(request, name):g}"
        for name in ("speed", "force", "torque", "seconds")
        if getattr(request, name) > (most := getattr(limits, name))
    ]
    if unfelt and less:
        less.append(unfelt)
    return Permit(
        request.name,
        request.kind,
        PermitState.LESS if less else PermitState.GRANTED,
        ", ".join(less),
        request.region,
        min(request.speed, limits.speed),
        min(request.force, limits.force),
        min(request.torque, limits.torque),
        now + min(request.seconds, limits.seconds),
    )


def touching(robot: Robot, request: PermitRequest) -> Mask:
    """(k,) bool, those of a robot's spheres that a request names."""
    spheres, tool = robot.spheres, robot.tool
    out = np.isin(
        spheres.link,
        [k for k, name in enumerate(robot.link_names) if k and name in request.parts],
    )
    if "tool" in request.parts and tool is not None:
        out[len(spheres.link) - len(tool.spheres.radius) :] = True
    if math.isfinite(request.reach):
        T_last_tcp = robot.T_last_flange @ (np.eye(4) if tool is None else tool.T_flange_tcp)
        away = np.linalg.norm(spheres.center - T_last_tcp[:3, 3], axis=1)
        out &= (np.asarray(spheres.link) == robot.n) & (away <= request.reach)
    return np.asarray(out)
