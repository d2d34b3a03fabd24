"""Following a route: as fast along it as the filter allows, or away from what is nearest."""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import JointVector
from armsight.motion.data import GuardMode
from armsight.motion.guard_config import GuardConfig
from armsight.motion.reflex import FLEE
from armsight.motion.route import Route, SpeedScale, rate_bounds
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter

LAG = 0.1
"""Share by which the drives' ramp may lag behind the allowed speed before the brakes are used."""
LEAD = 0.75
"""The command is the motion's velocity this far into the coming tick: the drives ramp up to it."""
LOOK = 0.02
"""A way out is looked at so far ahead, of the arm's fastest point [m]."""
SIDEWAYS = 0.15
"""On it a part may come nearer to something by this share of what the nearest one leaves."""
STOP_ROOM = 0.04
"""Phase time that is kept free before a blocked place, besides the way to stop [s]."""


class RouteFollower:
    """Drives the arm along routes by one speed scale.

    Attributes:
        scale: the share of the planned speed in use.
    """

    def __init__(self, filter_: VelocityFilter, config: GuardConfig) -> None:
        self.scale = SpeedScale(config.rise, config.rise_jerk)
        self._filter = filter_
        self._config = config

    def follow(self, tick: Tick, route: Route, limit: float, full: float) -> None:
        """Drive along a route, as fast as everything allows.

        Args:
            tick: decided here.
            route: to follow.
            limit: share of the planned speed wanted at most.
            full: share that the task may use.
        """
        config, scale = self._config, self.scale
        route.advance(scale.value * tick.elapsed)
        wanted = route.wanted(tick.ahead.position, LEAD * scale.value * config.period)
        motion = wanted.velocity + config.gain * wanted.correction
        tick.view = self._filter.judge(tick, motion)
        slowest, fastest = rate_bounds(
            scale.value, wanted.velocity, wanted.acceleration, self._filter.arm.acceleration
        )
        limit = min(limit, self._room_scale(route, wanted.velocity))
        share = tick.view.allowed
        ramp = scale.value + min(slowest, 0.0) * tick.elapsed
        target = share if share < max(limit, ramp) else max(limit, ramp)
        square = float(motion @ motion)
        actual = float(tick.ahead.velocity @ motion) / square if square > 1e-9 else 0.0
        tick.pace = max(min(actual, share, 1.0), 0.0)  # where it goes on after braking, if it may
        if actual > share + LAG and not tick.at_rest and square > 1e-6:
            self.brake(tick, route)
        else:
            value = scale.towards(target, tick.elapsed, fastest)
            tick.command = value * motion
            if not self._filter.stop_is_free(tick) and value > ramp:
                scale.reset(max(ramp, 0.0))
                tick.command = scale.value * motion
                tick.reason = "keeps room to stop"
        tick.scale = scale.value
        tick.mode = GuardMode.PREDICTIVE
        if min(share, 1.0) < limit - 1e-3:
            tick.mode = GuardMode.SLOWED if share > 1e-3 else GuardMode.STOPPED
            tick.reason = self._filter.who(tick.view)
        elif math.isfinite(route.blocked_at) and limit < 0.5 * full:
            tick.mode = GuardMode.SLOWED
            tick.reason = "the path ahead is blocked"

    def brake(self, tick: Tick, route: Route | None) -> None:
        """Stop as hard as the drives can; pick the route up where that leads."""
        tick.stop_hard()
        if route is not None:
            route.rejoin(tick.ahead.position)
        self.scale.reset(tick.pace)

    def flee(self, tick: Tick) -> bool:
        """Along the inverted vector from the nearest part, within all that separation demands.

        Returns:
            Whether there is a way that is proven free.
        """
        monitor, near = self._filter.monitor, tick.near
        wanted = monitor.away(near, tick.ahead.position, self._filter.hazards, FLEE)
        wanted = self._filter.conform(tick, wanted)
        tick.view = self._filter.judge(tick, wanted)
        share = min(tick.view.allowed, 1.0)
        share = max(share, self._creeps_out(tick, wanted, share))
        scale = self.scale.towards(share, tick.elapsed, math.inf)
        tick.command = scale * wanted
        tick.scale = scale
        if self._filter.stop_is_free(tick):
            return True
        tick.command = np.zeros(len(tick.command))
        self.scale.reset()
        return False

    def _creeps_out(self, tick: Tick, motion: JointVector, allowed: float) -> float:
        """Share of a way out that an arm may take which counts as standing; 0 for none.

        Nor where more than that is ``allowed`` in any case.

        Every turn brings some part a little nearer to something: the other end of the link that
        leaves. An arm between places that could hide somebody would stand there for good. So a way
        that leads away from the nearest one is taken, if no part comes nearer to anything by more
        than a small share of that.
        """
        monitor, hazards, q = self._filter.monitor, self._filter.hazards, tick.ahead.position
        velocity = monitor.body.motion(q, motion)[1]
        fastest = monitor.body.fastest(q, motion, velocity)
        if fastest < 1e-6 or allowed >= self._config.retreat_speed / fastest:
            return 0.0
        here = monitor.at_rest(q, hazards)
        there = monitor.at_rest(q + LOOK * motion / fastest, hazards)
        gain = there.least - here.least
        lost = np.where(np.isfinite(here.distance), here.distance - there.distance, 0.0)
        if gain < SIDEWAYS * LOOK or float(lost.max()) > SIDEWAYS * gain:
            return 0.0
        return self._config.retreat_speed / fastest

    def _room_scale(self, route: Route, velocity: JointVector) -> float:
        """Greatest scale from which the arm still stops before a blocked place."""
        if math.isinf(route.blocked_at):
            return math.inf
        room = max(route.blocked_at - route.phase - STOP_ROOM, 0.0)
        fastest = np.abs(velocity) / self._filter.arm.acceleration
        slowing = 0.7 / max(float(fastest.max()), 1e-3)
        return math.sqrt(2.0 * slowing * room)
