"""What may end any state of a visit: lost permits, cars that move, what is felt in free air."""

from __future__ import annotations

import math

import numpy as np

from armsight.charging.feeling import TUG
from armsight.charging.hand import IN
from armsight.charging.lid_states import LidStates
from armsight.charging.vehicle import VehicleStatus
from armsight.charging.visit import IN_CONTACT, Seen, State

NUMB = 0.5
"""A force sensor that has said nothing for so long is dead [s]."""
IN_FREE_AIR = (
    State.SHOW, State.LOOK, State.APPROACH, State.ALIGN, State.TARE, State.LEAVE,
    State.LID_LOOK, State.LID_BEFORE, State.LID_ALIGN, State.LID_TARE,
)  # fmt: skip
LOOSE = 1.0
"""What was pressed before it left is loose after this time [s]."""


class StationWatch(LidStates):
    """Looked at in every round, before the state has its say."""

    def _watch(self, seen: Seen, car: VehicleStatus | None) -> None:
        """Lost permits, cars that move, states that take too long, a wish to end."""
        state, lost = self.state, self.permission.lost(seen.guard)
        if lost and self._waiting.begins(seen, state, self.permission, self._hand.plug(seen)):
            self.words = f"waits: {lost}"
        elif state in IN_CONTACT and lost:
            self.visits.blame(lost)
            self._lid_held = state in (State.LID_WORK, State.LID_AWAY)
            self._go(State.HELD, seen.now, lost)
            return
        if self._caught(seen):
            return
        if state in (State.STAND_BY, State.STUCK, State.HELD):
            return
        forced = (State.INSERT, State.UNPLUG, State.LID_WORK, State.LID_AWAY)
        if state in forced and self._hand.feeling.silent(seen.now) > NUMB:
            self._numb(seen)
            return
        leaving = state in (State.UNPLUG, State.LEAVE, State.LID_AWAY)
        shutting = self.finger is not None and self.finger.shutting
        if car is not None and not car.parked and not leaving:
            if self.finger is not None:
                self.finger.opened = False  # it is where the car went
            self._fail(seen, car.problem or "the car moves")
        elif state is State.CHARGE:
            return
        elif self._ending and not leaving and not shutting:
            self._fail(seen, "ended by hand")
        elif self._waiting.under_way and leaving:
            return  # it comes out when it may
        elif self._in_state(seen) > self._patience:
            why = seen.guard.reason if seen.guard is not None and seen.guard.reason else ""
            words = f"{state.value}: no end after {self._patience:.0f} s"
            why = why or (self.words if self.words.startswith("waits") else "")
            words = f"{words} ({why})" if why else words
            if leaving:
                self._go(State.STUCK, seen.now, f"{words}; help by hand")
            else:
                self._fail(seen, words)

    def _caught(self, seen: Seen) -> bool:
        """Whether something holds the plug, or its cable, where nothing should: then it stops.

        Neither on nor back is safe then: nobody knows where the cable lies.
        """
        homing = self.state is State.STAND_BY and self._way_out.kept
        if not (self.state in IN_FREE_AIR or homing):
            return False
        pull = self._hand.feeling.pull
        if math.isnan(self._hung):
            self._hung = pull  # it was killed on its way
        if self.state in (State.LEAVE, State.SHOW) and self._in_state(seen) < LOOSE:
            # A sensor may have jumped, a plug been exchanged: what comes on top tells.
            self._hung = pull if np.isfinite(pull) else self._hung
            return False
        if not pull > self._hung + TUG:
            return False
        words = (
            f"{pull:.0f} N hold the plug in free air, {self._hung:.0f} when it set out: is its "
            "cable caught? Free it by hand"
        )
        self.visits.blame(words)
        self._go(State.STUCK, seen.now, words)
        return True

    def _numb(self, seen: Seen) -> None:
        """Nobody feels any more: what is in the car stays in it, what is out leaves."""
        frozen = self._hand.feeling.frozen
        silent = f"the force sensor {'repeats itself' if frozen else 'is silent'}"
        if self.state in (State.LID_WORK, State.LID_AWAY):
            self.visits.blame(silent)
            words = f"{silent} and the finger is at the lid: bring it out by hand"
            self._go(State.STUCK, seen.now, words)
        elif self._hand.depth(seen, self._face) > IN:
            self.visits.blame(silent)
            words = f"{silent} and the plug is in the car: mend the sensor, or take it out by hand"
            self._go(State.STUCK, seen.now, words)
        else:
            self._fail(seen, silent)
