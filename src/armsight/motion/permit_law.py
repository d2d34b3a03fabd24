"""How fast the arm may come to what it is permitted to touch, and press it.

Two bounds. The blow: two masses and a spring (:mod:`armsight.motion.contact_limits`), for a hand or
a face. The press: until the arm stands it goes on for the time of the reading, of a late tick and
of the drives, and what gives way pushes back by its stiffness all the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.mapping.tracked import SURE
from armsight.motion.contact_limits import contact_speed, effective_mass
from armsight.motion.force_watch import FELT, LEAD, STALE, held_force
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permits import Permit, PermitRequest
from armsight.motion.permitted import Grant
from armsight.motion.retreat import CLEAR
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import SprungTip, press_depth

MUSCLES = 1000.0
"""No hand or head resists a push with more than this, save against something firm [N/m]."""
UNSEEN = 0.01
"""Arm and target may come together faster than is counted by this [m/s]: drives overshoot by
5 mm/s, and a hand that sways (0.07 m/s2) is another 5 mm/s faster than when it was seen."""
ARM_ERROR = 0.003
"""A part that comes to touch, slowly, is this close to where the joints say [m]."""
STEPS = np.linspace(0.0, 1.0, 8)
"""At these shares of ``LEAD`` it is looked where parts are that go on."""
SHARE = 0.6
"""Share of the force that may be left to be used up while the arm stops."""
SLOWS = 2.0
"""An arm's tip slows by this much at least when it brakes [m/s^2]."""
LEAST = 0.002
"""The arm may always move this slowly in contact: back, if nothing else [m/s]."""


def floating(robot: Robot, request: PermitRequest | None) -> SprungTip | None:
    """How what a permit lets touch gives way by itself; None where any of it is stiff.

    Args:
        robot: with its tool.
        request: that was granted, or None.
    """
    tip = None if robot.tool is None else robot.tool.tip
    if tip is None or request is None or any(part != "tool" for part in request.parts):
        return None
    return tip if request.reach <= tip.length else None


def stopping_way(config: GuardConfig, now: float, then: float) -> float:
    """How far [m] the arm still comes to what it touches if it stops now, or a tick too late.

    Args:
        config: of the guard.
        now: how fast the two come together [m/s].
        then: the same when the next command acts.
    """
    now, then = max(now, 0.0), max(then, 0.0)
    before = 0.5 * (now + then) * config.start_delay + then * config.period
    return before + then**2 / (2.0 * SLOWS)


def within_reach(
    body: MovingBody,
    grant: Grant,
    q: JointVector,
    rates: Sequence[JointVector],
    now: float,
    unsure: float = 0.0,
) -> bool:
    """Whether the parts that may touch are so near to what they may that it could be pressed.

    A press is foretold for ``LEAD``: what they do not come to in that time, going on as they go or
    are told to, is not touched now and will not be by then. What is felt is the arm's own inertia.

    Args:
        body: the arm's moving parts.
        grant: what may be touched.
        q: (n,) where the arm is [rad].
        rates: (n,) joint velocities that it has or is told [rad/s].
        now: time [s].
        unsure: the region may come faster than it is told to by this [m/s].
    """
    region, parts = grant.region, np.flatnonzero(grant.touching[body.moving])
    if not len(parts):
        return False
    margin = ARM_ERROR + SURE * region.deviation(now) + CLEAR + LEAD * unsure
    for rate in rates:
        center, velocity = (found[parts] for found in body.motion(q, rate))
        way = LEAD * (velocity - region.velocity)
        places = center + STEPS[:, None, None] * way
        away = region.distance(places.reshape(-1, 3), now).reshape(len(STEPS), -1)
        between = 0.5 * float(STEPS[1]) * np.linalg.norm(way, axis=1)
        if float((away - body.radius[parts] - between).min()) < margin:
            return True
    return False


def pressing_speed(
    config: GuardConfig,
    permit: Permit | None,
    stiffness: float,
    tip: SprungTip | None = None,
) -> float:
    """Speed [m/s] from which the arm stops before what it touches is pressed too hard.

    Args:
        config: of the guard.
        permit: what holds, with what is felt; None for an arm that leaves.
        stiffness: of what is touched [N/m].
        tip: how the arm's own tip gives way; None where it does not.
    """
    if permit is None or not permit.holds or not stiffness > 0.0:
        return config.retreat_speed
    late = STALE + 2.0 * config.period + config.start_delay
    felt = 0.0 if math.isnan(permit.pressed) else permit.pressed
    pressed = felt if felt > FELT else 0.0

    def depth(force: float) -> float:
        return press_depth(force, stiffness, tip)

    way = depth(pressed + SHARE * (permit.force - pressed)) - depth(pressed)
    # On a spring the way is long, and so is what braking takes of it: all of it has to do.
    rest = max(depth(permit.force) - depth(felt), 0.0)
    in_time = math.sqrt((SLOWS * late) ** 2 + 2.0 * SLOWS * rest) - SLOWS * late
    return max(min(way / late, in_time), LEAST)


def gentle_speed(
    robot: Robot, config: GuardConfig, permit: Permit, middle: Vector3, q: JointVector
) -> float:
    """Speed [m/s] at which the arm may meet a part of a body, by power and force limiting.

    Args:
        robot: with its tool.
        config: of its guard.
        permit: for a hand or a face.
        middle: (3,) centre of its region [m].
        q: (n,) where the arm is [rad].
    """
    body = BODY_REGIONS["hand" if permit.kind == "hand" else "face"]
    tip = tcp_pose(robot, q)[:3, 3]
    way = middle - tip
    away = float(np.linalg.norm(way))
    way = way / away if away > 1e-6 else np.array([0.0, 0.0, 1.0])
    mass = effective_mass(robot, q, robot.n, tip, way)
    soft = config.soft if config.soft > 0.0 else math.inf
    blow = contact_speed(body, mass, min(permit.force, body.force), soft) - UNSEEN
    # After the blow the body is held by its own muscles only, or by what covers the tool.
    return max(min(blow, pressing_speed(config, _for_long(permit), min(MUSCLES, soft))), LEAST)


def clamped_speed(config: GuardConfig, permit: Permit) -> float:
    """Speed [m/s] at which the arm may press a part of a body against something firm.

    Args:
        config: of the guard.
        permit: for a hand or a face.
    """
    body = BODY_REGIONS["hand" if permit.kind == "hand" else "face"]
    stiffness = body.stiffness
    if config.soft > 0.0:
        stiffness = 1.0 / (1.0 / stiffness + 1.0 / config.soft)
    return pressing_speed(config, _for_long(permit), stiffness)


def _for_long(permit: Permit) -> Permit:
    """A permit with the force that a hand is pressed with for longer than a slip takes."""
    if permit.kind != "hand":
        return permit
    return replace(permit, force=held_force(permit.force))
