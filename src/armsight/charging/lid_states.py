"""States of a visit in which a lid is looked at, opened before, and shut after."""

from __future__ import annotations

import math

import numpy as np

from armsight.charging.eye import SeenPort
from armsight.charging.lid_eye import LidLook
from armsight.charging.lid_finger import OUT, LidFinger
from armsight.charging.looking import INLETS_OF
from armsight.charging.moves import apart
from armsight.charging.show_states import ShowStates
from armsight.charging.station_core import ARRIVED, SAME, reached
from armsight.charging.vehicle import VehicleStatus
from armsight.charging.visit import Seen, State, Wish
from armsight.geometry.pose import inverse
from armsight.motion.data import GuardMode
from armsight.motion.intents import PoseIntent, Rest


class LidStates(ShowStates):
    """The states; what they need besides is :class:`LidFinger`."""

    def _lid_found(self, seen: Seen, look: LidLook, sigma: float) -> None:
        """A shut lid: its port is behind it, and the lid shall be opened."""
        lid = self._finger
        assert look.T_base_lid is not None
        T_port, covariance = lid.see(look.T_base_lid, look.covariance)
        wrong = self._impossible(T_port)
        if wrong:
            self._fail(seen, wrong)
            return
        port = INLETS_OF[self.options.plug][0]
        self.port, self._looked = SeenPort(port, look.score, T_port, covariance, False), 0
        self._sigma = sigma
        self.permission.see_lid(look.T_base_lid, look.covariance, look.stamp, sigma)
        if self._unkept(seen):
            return
        if math.isnan(self.outcome.found):
            self.visits.note(port=port, score=look.score, found=seen.now)
        near = self.state is State.FIND and self._T_near is not None
        self._on(seen, State.LID_LOOK if near else State.LID_BEFORE)

    def _lid_look(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From near: the finger has to meet it within millimetres."""
        o, lid = self.options, self._finger
        assert lid.T_base_lid is not None
        goal, there = self._from_near(seen, lid.looked_at(), o.lid_from, "look at lid")
        if not there:
            return Wish(goal)
        look = self._looker.fresh_lid(seen, o.near, self._begun(seen))
        if look is not None:
            self._looked += 1
            gap = math.inf
            if look.T_base_lid is not None:
                gap = float(np.linalg.norm((look.T_base_lid - lid.T_base_lid)[:3, 3]))
            if gap < SAME:
                self._lid_found(seen, look, o.near_sigma)
            elif self._looked >= o.looks:
                self._fail(seen, "the lid that was seen from afar is not seen from near")
            else:
                self._other_side(seen, "again from another side")
        elif self._in_state(seen) > 0.5 * o.patience:
            self.words = f"waits for pictures of {o.near}"
        return Wish(goal, (o.near,))

    def _lid_before(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """The finger before the lid, on its way out."""
        T_tip = self._finger.before() @ inverse(self._hand.feeling.T_flange_plug) @ self._T_tip
        goal = PoseIntent(self._goal("to lid"), T_tip, 0.003, 0.02, permit=self._ask(seen))
        if reached(seen, goal.name) and self._rests(seen, 0.4):
            self._hand.feeling.hang()
            self._go(State.LID_ALIGN, seen.now)
        return Wish(goal)

    def _lid_align(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """As it hangs now that the hand is turned; what turns after taring is felt as a force."""
        goal = self._finger.before()
        if all(a < b for a, b in zip(apart(self._hand.plug(seen), goal), ARRIVED)):
            self._go(State.LID_TARE, seen.now)
        return self._hand.straight(seen, goal, self.state.value)

    def _lid_tare(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """At rest, the finger out: what is felt now is no contact; where it works is written."""
        lid = self._finger
        if not self.permission.holds(seen.guard):
            permit = None if seen.guard is None else seen.guard.permit
            self.words = f"waits for leave to touch: {'' if permit is None else permit.reason}"
        elif seen.drawn_back is None or seen.drawn_back > OUT:
            self.words = "waits for the finger to come out"
        elif self._rests(seen, self.options.settle):
            if not self._hand.feeling.zero(seen.now):
                self._fail(seen, "the force sensor is silent or noisy: nobody would feel the lid")
            elif problem := self._keep(at_lid=True):
                self._fail(seen, f"does not touch the lid: {problem}")
            else:
                lid.work("shut" if lid.shutting else "open")
                self._go(State.LID_WORK, seen.now)
        return Wish(Rest("tares", permit=self._ask(seen)))

    def _lid_work(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        wish = self._by_finger(seen)
        hand = self._finger.hand
        assert hand is not None
        if hand.ended and hand.caught:
            self.visits.blame(hand.problem)
            self._caught_at_lid(seen, hand.caught)
        elif hand.ended:
            self._lid_worked(seen, hand.problem)
        return wish

    def _lid_away(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Out from the lid, whatever became of it; then home."""
        wish = self._by_finger(seen)
        hand = self._finger.hand
        assert hand is not None
        if hand.ended and hand.problem:
            self._caught_at_lid(seen, hand.problem)
        elif hand.ended:
            self._finger.opened = False
            self._out()
            self._finish(seen)
        return wish

    def _caught_at_lid(self, seen: Seen, why: str) -> None:
        """The finger did not come away: no path begins there."""
        self._go(State.STUCK, seen.now, f"coming away from the lid: {why}; help by hand")

    def _lid_worked(self, seen: Seen, problem: str) -> None:
        """The hand has ended and is out of the lid's way."""
        lid = self._finger
        lid.opened = not lid.shutting and not problem
        self._out()
        if lid.shutting:
            self.visits.note(lid_shut=not problem)
        elif not problem:
            self.visits.note(lid_opened=True)
            self._looked = self._side = 0
            self._go(State.LOOK, seen.now, "the lid is open")
            return
        self.visits.blame(f"{'shutting' if lid.shutting else 'opening'} the lid: {problem}"
                          if problem else "")  # fmt: skip
        self._finish(seen)

    def _leave_lid(self, seen: Seen) -> None:
        """Whatever the finger did: it comes away."""
        self._finger.work("leave")
        self._go(State.LID_AWAY, seen.now, self.words)

    def _by_finger(self, seen: Seen) -> Wish:
        """One step of the hand at the lid."""
        lid, guard = self._finger, seen.guard
        held = guard is not None and guard.mode is GuardMode.STOPPED
        twist = lid.step(seen.now, self._hand.plug(seen), held)
        if twist is None:
            return Wish(Rest("the force sensor is silent", True, self._ask(seen)))
        if lid.touches(seen.now):
            self.permission.felt(seen.now)
        assert lid.hand is not None
        self.words = lid.hand.words
        return self._hand.moving(seen, twist, self.state.value, bound=True)

    @property
    def _finger(self) -> LidFinger:
        assert self.finger is not None
        return self.finger
