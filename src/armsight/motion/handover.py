"""From a velocity to a planned motion without standing still.

A plan begins at rest, and takes a tenth of a second to come. So the arm goes on for a moment as it
does and then slows down to a place that is known beforehand (:func:`coast`); the plan is asked for
from there. When it comes, the arm is still under way: it joins the plan's motion as if that were a
velocity that a task asks for, with the limits, the separation and the verified stop of one
(:meth:`.Steering.pursue`), until it is on it and follows it as a route.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import ArmState
from armsight.motion.collision import CollisionModel
from armsight.motion.route import Route
from armsight.motion.tick import Tick
from armsight.motion.trajectory import Trajectory, coasting
from armsight.robots.robot import JointLimits

HOLDS = (0.16, 0.08, 0.0)
"""How long the arm may go on as it does before it slows down [s], the longest that is free."""
NEAR = 0.01
"""An arm this close to its route [rad] follows it ..."""
ALIKE = 0.5
"""... if its velocity is off by no more than this share of what it may change in a tick."""


def coast(
    model: CollisionModel,
    snapshot: WorkspaceSnapshot,
    state: ArmState,
    acceleration: JointVector,
    limits: JointLimits,
) -> Trajectory | None:
    """The way on and to rest from a moving state, proven free; None if there is none.

    Args:
        model: collision checks.
        snapshot: the surroundings.
        state: where the arm will be when the next command acts.
        acceleration: (n,) of the motion under way [rad/s^2].
        limits: kept while slowing down.
    """
    for hold in HOLDS:
        motion = coasting(state.position, state.velocity, acceleration, hold, limits)
        if model.trajectory_valid(motion, snapshot, at=state.position):
            return motion
    return None


def joined(tick: Tick, route: Route, motion: JointVector, most: JointVector) -> bool:
    """Whether the arm is on a route and moves as it asks, or stands.

    Args:
        tick: what is commanded.
        route: to be on.
        motion: (n,) velocity that it asks for [rad/s].
        most: (n,) by how much a velocity may change in a tick [rad/s].
    """
    off = np.abs(route.wanted(tick.ahead.position).correction).max()
    differs = (np.abs(tick.command - motion) / most).max()
    return tick.at_rest or bool(off < NEAR and differs < ALIKE)
