"""What a task may ask of the guard: a joint goal, a pose of the TCP, a velocity, or rest.

An intent is a wish. The guard alone commands the arm, and grants of a wish what limits, people,
obstacles and faults leave of it. Intents are checked where they arrive, not where they are made: a
wrong one never raises, it is refused in words and the arm comes to rest (:func:`refusal`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.geometry.pose import is_rotation
from armsight.motion.permits import PermitRequest
from armsight.robots.robot import Robot

HORIZON = 1.0
"""A velocity is valid for this long after its evidence at most [s]: evidence does not keep."""
FUTURE = 0.01
"""Evidence may be this far ahead of the guard's clock [s]; more is a clock that lies."""

Frame: TypeAlias = Literal["joint", "base", "tcp"]
"""What a velocity is of: the joints, or the TCP with axes of ``base`` or of the TCP itself."""


@dataclass(frozen=True)
class JointIntent:
    """Bring the joints to a configuration, along a planned and proven path.

    Attributes:
        name: for the page and the log, such as ``A``.
        position: (n,) [rad].
        tolerance: reached when every joint is this close [rad].
        speed: share of the cell's allowed speed, 0..1.
        permit: what it has to touch on the way or there, see :mod:`armsight.motion.permits`.
        width: how far the gripper shall be open [m]; None leaves it as it is.
    """

    name: str
    position: JointVector
    tolerance: float = 0.01
    speed: float = 1.0
    permit: PermitRequest | None = None
    width: float | None = None


@dataclass(frozen=True)
class PoseIntent:
    """Bring the TCP to a pose, along a planned and proven path.

    All inverse solutions are weighed, and the one is taken that is there soonest, people counted.

    Attributes:
        name: for the page and the log.
        T_base_tcp: (4, 4) wanted pose of the TCP: the tool's tip, or the flange without a tool.
        tolerance: reached when the TCP is this close [m]; tolerance_rad: and turned by no more
            than this [rad].
        speed: share of the cell's allowed speed, 0..1.
        permit: what it has to touch on the way or there.
        width: how far the gripper shall be open [m]; None leaves it as it is.
        room: who goes on from there wants every joint to be this far from the end of its travel
            [rad]; one that is nearer is led there only where there is no other way.
    """

    name: str
    T_base_tcp: Pose
    tolerance: float = 0.001
    tolerance_rad: float = 0.005
    speed: float = 1.0
    permit: PermitRequest | None = None
    width: float | None = None
    room: float = 0.0


@dataclass(frozen=True)
class VelocityIntent:
    """Move with a velocity until told otherwise, or until it is no longer valid.

    The guard keeps the direction where it can, ramps within the limits of acceleration and jerk,
    slides along or slows for whatever is near, and says in ``GuardStatus.command`` what it really
    commanded: integrate that, not the wish.

    Attributes:
        name: for the page and the log.
        velocity: (n,) joint velocities [rad/s], or a (6,) twist of the TCP: linear [m/s], then
            angular [rad/s].
        frame: ``joint``; or for a twist whose axes it has, ``base`` or ``tcp``. Either way it is
            the velocity of the TCP's own point.
        exposure: when the evidence for it was exposed [s]: the stamp of the oldest picture, or
            joint reading, that it rests on.
        valid_until: from then on it is stale and the arm comes to rest [s]; at most 1 s
            after the exposure.
        permit: what it has to touch.
        width: how far the gripper shall be open [m]; None leaves it as it is.
        bound: the tool cannot go aside, as a plug in its socket: what is near slows it, and does
            not make it slide.
    """

    name: str
    velocity: Floats
    frame: Frame
    exposure: float
    valid_until: float
    permit: PermitRequest | None = None
    width: float | None = None
    bound: bool = False


@dataclass(frozen=True)
class Rest:
    """Come to rest and hold.

    Attributes:
        reason: why, for the page and the log; may be empty.
        fault: something is wrong: shown as a stop, not as a pause.
        permit: what it goes on touching.
        width: how far the gripper shall be open [m]; None leaves it as it is.
    """

    reason: str = ""
    fault: bool = False
    permit: PermitRequest | None = None
    width: float | None = None


Intent: TypeAlias = JointIntent | PoseIntent | VelocityIntent | Rest
"""What a task publishes. None means the same as :class:`Rest`."""


def refusal(intent: Any, robot: Robot, now: float = math.nan) -> str:
    """Why an intent cannot be pursued, in words; empty when it can. Never raises.

    Args:
        intent: whatever a task published.
        robot: the arm that is asked.
        now: the guard's time [s]; without it stamps are checked for being numbers only.
    """
    try:
        if isinstance(intent, JointIntent):
            return _of_joints(intent, robot)
        if isinstance(intent, PoseIntent):
            return _of_pose(intent)
        if isinstance(intent, VelocityIntent):
            return _of_velocity(intent, robot, now)
        if intent is None or isinstance(intent, Rest):
            return ""
    except (TypeError, ValueError, AttributeError) as error:
        return f"goal {getattr(intent, 'name', '?')}: {error}"
    return (
        f"a task published {type(intent).__name__}; expected JointIntent, PoseIntent, "
        "VelocityIntent, Rest or None"
    )


def _of_joints(intent: JointIntent, robot: Robot) -> str:
    q = _numbers(intent.position)
    limits, n = robot.limits, robot.n
    if q.shape != (n,):
        return f"goal {intent.name} has {q.size} joints; {robot.name} has {n}"
    if not np.isfinite(q).all():
        return f"goal {intent.name} is not finite: give {n} numbers in rad"
    fault = _pace(intent) or _above_zero(intent.name, "tolerance", intent.tolerance)
    if fault:
        return fault
    outside = np.maximum(limits.lower - q, q - limits.upper)
    if outside.max() > 0.0:
        j = int(np.argmax(outside))
        return (
            f"goal {intent.name}: {robot.joint_names[j]} at {q[j]:.3f} rad is outside its "
            f"limits {limits.lower[j]:.3f}..{limits.upper[j]:.3f}"
        )
    return ""


def _of_pose(intent: PoseIntent) -> str:
    T = _numbers(intent.T_base_tcp)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return f"goal {intent.name} is no pose: give a finite 4 x 4 matrix T_base_tcp"
    if not is_rotation(T[:3, :3]) or not np.allclose(T[3], (0.0, 0.0, 0.0, 1.0)):
        return f"goal {intent.name} is no pose: T_base_tcp is not a rotation and a translation"
    return (
        _pace(intent)
        or _above_zero(intent.name, "tolerance", intent.tolerance)
        or _above_zero(intent.name, "tolerance_rad", intent.tolerance_rad)
        or ("" if intent.room >= 0.0 else f"goal {intent.name}: room is {intent.room}; 0 or more")
    )


def _of_velocity(intent: VelocityIntent, robot: Robot, now: float) -> str:
    name = intent.name
    if intent.frame not in ("joint", "base", "tcp"):
        return f'velocity {name}: frame is "{intent.frame}"; expected joint, base or tcp'
    v = _numbers(intent.velocity)
    wanted = robot.n if intent.frame == "joint" else 6
    if v.shape != (wanted,):
        what = f"{wanted} joints" if intent.frame == "joint" else "a twist of 6"
        return f"velocity {name} has shape {v.shape}; expected {what}"
    if not np.isfinite(v).all():
        return f"velocity {name} is not finite"
    if not (math.isfinite(intent.exposure) and math.isfinite(intent.valid_until)):
        return f"velocity {name}: exposure and valid_until must be times in seconds"
    if intent.valid_until <= intent.exposure:
        return f"velocity {name} ends {intent.exposure - intent.valid_until:.3f} s before it begins"
    if intent.exposure > now + FUTURE:
        return f"velocity {name}: its evidence is from {intent.exposure - now:.3f} s in the future"
    lasts = intent.valid_until - intent.exposure
    if lasts > HORIZON:
        return f"velocity {name} is for {lasts:.1f} s after its evidence; at most {HORIZON:g} s"
    return ""


def _numbers(values: Any) -> Floats:
    """What a task gave as numbers; text that reads like one would fail where it is used.

    Raises:
        TypeError, ValueError: it is something else.
    """
    numbers = np.asarray(values, float)
    given = np.asarray(values).dtype
    if given.kind not in "biuf":
        raise TypeError(f"expected numbers, found {given.name}")
    return numbers


def _pace(intent: JointIntent | PoseIntent) -> str:
    if not 0.0 < intent.speed <= 1.0:
        return f"goal {intent.name} asks for speed {intent.speed}; expected above 0, at most 1"
    return ""


def _above_zero(name: str, field: str, value: float) -> str:
    if not (math.isfinite(value) and value > 0.0):
        return f"goal {name}: {field} is {value}; expected above 0"
    return ""
