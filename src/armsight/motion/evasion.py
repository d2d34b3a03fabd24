"""What the arm does that no task wants: the reflex, and backing out of a contact."""

from __future__ import annotations

import math

from armsight.arrays import Vector3
from armsight.motion.data import GuardMode
from armsight.motion.executed import Executed
from armsight.motion.following import RouteFollower
from armsight.motion.reflex import Reflex, ReflexStage
from armsight.motion.retreat import Retreat
from armsight.motion.steering import Steering
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter

RUBS = 0.005
"""On the way out of a contact the tool may slide so much deeper along what it touches [m]: an arm
that stands there is pressed on, and a sensor feels what the tool does."""


class Evasion:
    """Drives the arm where :class:`.Reflex` and :class:`.Retreat` say.

    Args:
        reflex: what is decided here is driven.
        filter_, follower, steering: of the same guard.
        executed: the way that the arm came.
    """

    def __init__(
        self,
        reflex: Reflex,
        filter_: VelocityFilter,
        follower: RouteFollower,
        steering: Steering,
        executed: Executed,
    ) -> None:
        self._reflex, self._filter = reflex, filter_
        self._follower, self._steering = follower, steering
        self._executed = executed

    def begin(self, tick: Tick) -> bool:
        """At rest at the beginning of a reflex: choose a way; whether one was chosen."""
        reflex, filter_ = self._reflex, self._filter
        if reflex.stage != ReflexStage.STOPPING or tick.snapshot is None:
            return False
        reflex.choose(
            tick.here.position, self._executed, filter_.monitor, filter_.hazards, filter_.model,
            tick.snapshot,
        )  # fmt: skip
        self._follower.scale.reset()
        return True

    def react(self, tick: Tick, full: float) -> None:
        """One tick of T2's reflex: retrace or leave, hold until the danger is over.

        Args:
            tick: decided here.
            full: share of the planned speed that the task may use.
        """
        reflex, distance = self._reflex, tick.near.least
        if reflex.stage == ReflexStage.RETRACE and reflex.route is not None:
            self._follower.follow(tick, reflex.route, 1.0, full)
            blocked = math.isfinite(reflex.route.blocked_at)
            if tick.at_rest and (reflex.route.done or blocked):
                reflex.hold()
        elif reflex.stage == ReflexStage.FLEE:
            self._flee(tick)
        tick.mode = GuardMode.REFLEX
        tick.reason = f"{reflex.stage.value}: {self._filter.who(tick.view)}"
        stuck = reflex.stage != ReflexStage.STOPPING and reflex.stuck(tick.now, tick.at_rest)
        if reflex.over(tick.now, distance) and tick.at_rest:
            reflex.end()
        elif stuck:
            reflex.try_other(distance)

    def back_out(self, tick: Tick, retreat: Retreat, push: Vector3 | None) -> None:
        """Out of a contact whose permit was withdrawn: brake, then back the way it came.

        Args:
            tick: decided here.
            retreat: the way out.
            push: (3,) force on the arm in ``base`` [N], where a sensor feels one.
        """
        self._reflex.end()
        retreat.braked = retreat.braked or tick.at_rest or self._steering.moving
        if retreat.braked:
            speed, body = self._filter.config.retreat_speed, self._filter.monitor.body
            motion = retreat.motion(body, tick.ahead.position, tick.now, speed, push)
            held = retreat.grant.out is not None
            self._steering.pursue(tick, motion, RUBS, bound=held, at_once=retreat.at_once)
        else:
            self._follower.brake(tick, None)
        tick.mode, tick.reason = GuardMode.REFLEX, f"backs out of contact: {retreat.reason}"

    def _flee(self, tick: Tick) -> None:
        """Away from what is nearest, while there is something and a proven way."""
        near = tick.near
        if near.nearest[near.closest] < 0 or self._reflex.over(tick.now, near.least):
            return
        if not self._follower.flee(tick) and tick.at_rest:
            self._reflex.hold()
