"""The state in which the arm shows its plug to the standing pair: is it the calibrated one?

It comes after the port was found: before that the car is something that nobody has explained, and
an arm beside it does not move. A doubt alone ends no visit: where no look is possible, it says so.
"""

from __future__ import annotations

from collections.abc import Sequence

from armsight.arrays import JointVector
from armsight.charging.station_core import StationCore, reached
from armsight.charging.vehicle import VehicleStatus
from armsight.charging.visit import Seen, State, Wish
from armsight.motion.intents import JointIntent

EACH, ALL = 9.0, 20.0
"""To get to one place before the pair, and to any [s]."""
LOOKING = 8.0
"""Looks at one place come within this time [s]."""
LOOK_AT_PLUG = "look at it; the next visit tries again"


class ShowStates(StationCore):
    """What it needs besides is :class:`PlugCheck`."""

    _places: Sequence[JointVector] | None = None
    _show_since = 0.0
    _after_show = State.LOOK

    def _on(self, seen: Seen, state: State) -> None:
        """On after a look at port or lid: from afar by way of showing the plug, if need be."""
        if self.state is not State.FIND or not self.check.doubt:
            self._go(state, seen.now)
            return
        self._after_show, self._places, self._show_since = state, None, seen.now
        self._looked = self._side = 0
        self._go(State.SHOW, seen.now, self.check.doubt)

    def _show(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From place to place until a look says what it is, or none is to be had."""
        if self._places is None:
            self._places = self._shows()
        places = self._places
        if places is not None and self._side < len(places):
            return self._show_at(seen, places[self._side])
        if places is not None:
            self._unshown(seen, "no other place before it can be reached")
        elif seen.now - self._show_since > ALL:
            self._unshown(seen, "the map does not count the car")
        home = self._stand_by_joints
        return Wish(JointIntent("stand by", home, permit=self._ask(seen)))

    def _show_at(self, seen: Seen, place: JointVector) -> Wish:
        o = self.options
        goal = JointIntent(self._goal("show"), place, permit=self._ask(seen))
        if not reached(seen, goal.name):
            why = "" if seen.guard is None else seen.guard.reason
            if seen.now - self._show_since > ALL:
                self._unshown(seen, f"not there after {ALL:.0f} s ({why or 'on the way'})")
            elif self._in_state(seen) > EACH:
                self._other_side(seen, self.check.doubt)
            return Wish(goal)
        self._hand.feeling.hang()
        self._T_shown = self._hand.plug(seen)
        look = self._looker.fresh(seen, o.far, self._begun(seen))
        if look is not None:
            self._looked += 1
            wrong = self.check.wrong(look, self._T_shown)
            if wrong:
                self._fail(seen, wrong)
            elif wrong == "":
                self._shown_to_the_end(seen, "")
            elif self._looked >= o.looks:
                self._unshown(seen, "it is not seen clearly")
        elif self._in_state(seen) > EACH + LOOKING:
            self._unshown(seen, f"no pictures of {o.far}")
        return Wish(goal, (o.far,))

    def _unshown(self, seen: Seen, why: str) -> None:
        """No look: on with a warning, or not where somebody asked for it or it pulls otherwise."""
        words = f"the plug was not looked at ({self.check.doubt}): {self.options.far}: {why}"
        refusal = self.check.refusal
        if refusal:
            self._fail(seen, f"{words}; {refusal}: {LOOK_AT_PLUG}")
            return
        self.visits.note(warning=words)
        self._shown_to_the_end(seen, words)

    def _shown_to_the_end(self, seen: Seen, words: str) -> None:
        self._looked = self._side = 0
        self._go(self._after_show, seen.now, words)
