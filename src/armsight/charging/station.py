"""The charging station: one visit after the other, as a state machine that answers with intents.

Find the port from afar, look again from near, approach, align, plug in by force, charge, unplug,
stand by. It never sees the arm: what it wants are intents to the guard, and near the port a permit
to touch it with the plug. What is needed to come out is on disk before the plug goes near; a
station that finds that entry when it starts brings the plug out first.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.arrays import Pose
from armsight.charging.eye import SeenPort
from armsight.charging.going_along import GoingAlong
from armsight.charging.hand import IN, after_kill
from armsight.charging.insert import Answer, Insertion, Phase
from armsight.charging.insert_paper import PaperInsertion
from armsight.charging.journal import Entry
from armsight.charging.looking import INLETS_OF
from armsight.charging.moves import apart, before_port
from armsight.charging.station_core import ARRIVED, SAME, reached
from armsight.charging.station_watch import StationWatch
from armsight.charging.vehicle import VehicleStatus
from armsight.charging.visit import AT_LID, Outcome, Seen, State, Wish
from armsight.geometry.pose import inverse
from armsight.motion.intents import JointIntent, PoseIntent, Rest

RELAX = 1.5
"""After seating the law lets the force go down for so long [s]."""
LED = 0.02
"""Nothing in free air brings the plug so far from the port's axis but the guard [m]."""
NOT_HEARD = "charges; nothing is heard of the car: end by hand"
NOT_CHARGED = "plugged in, but the car does not charge: end by hand"


class Station(StationWatch):
    """One plug, one place for cars; see ``StationCore`` for what it is made of."""

    def step(self, seen: Seen) -> Wish:
        """One round."""
        if self._since is None:
            self._since = seen.now
        self._hand.feeling.take(seen)
        self._looker.take(seen)
        if self._way_out.left is not None:
            self._recover(seen, self._way_out.left)
        car = self.vehicle.status(seen.now)
        self._watch(seen, car)
        act = "wait" if self._waiting.under_way else self.state.name.lower()
        wish: Wish = getattr(self, f"_{act}")(seen, car)
        if self._lid_setup is None or self.state in (State.STUCK, State.HELD):
            return wish  # a finger that is at a lid stays as it is
        width = 0.0 if self.state in AT_LID else self._lid_setup.stroke
        return replace(wish, intent=replace(wish.intent, width=width))

    def _recover(self, seen: Seen, entry: Entry) -> None:
        """A station that was killed: where is the plug, and what now?"""
        self._way_out.left = None
        strange = ""
        if entry.plug != self.options.plug:
            strange = f"the journal is of a {entry.plug}; look at the plug"
        elif entry.at_lid and self.finger is None:
            strange = "was stopped with a finger at a lid, and here is none; look at the finger"
        if strange:
            words = f"{strange}, bring the arm out by hand and remove {self._journal.file}"
            self.visits.begin(Outcome(port=entry.port, began=seen.now, out=False))
            self._go(State.STUCK, seen.now, words)
            return
        self.port = SeenPort(entry.port, 1.0, entry.T_base_port, entry.covariance, False)
        self._sigma = 0.0  # it is in what was written
        self.permission.see(self.port, seen.now, self._sigma, entry.tare)
        self._hand.feeling.T_flange_plug, self._hand.feeling.tare = entry.T_flange_plug, entry.tare
        self.visits.begin(Outcome(port=entry.port, began=seen.now, out=False, seated=entry.plugged))
        state, words = after_kill(entry, self._hand.plug(seen))
        if self.finger is not None and entry.T_base_lid is not None:
            self.finger.T_base_lid, self.finger.opened = entry.T_base_lid, not entry.at_lid
            self.finger.covariance = np.zeros((6, 6))
            if entry.at_lid:
                sigma = self.options.near_sigma
                six = np.zeros((6, 6))
                self.permission.see_lid(entry.T_base_lid, six, seen.now, sigma, entry.tare)
                self.visits.blame(words)
                self._leave_lid(seen)
                return
        if state is not State.CHARGE:
            self.visits.blame(words)
            self._again = self.options.tries  # out, and no more: somebody asks for the next visit
        if state is State.STAND_BY:
            self._out()
            self._finish(seen)
        else:
            self._go(state, seen.now, words)

    def _wait(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Until it may touch again; then on, or from before the port if it was led back."""
        if self.permission.holds(seen.guard):
            waited, led_back = self._waiting.end(seen.now, self._hand.plug(seen))
            self._since = self._begun(seen) + waited
            if led_back and self.state is State.INSERT:
                if self._hand.depth(seen, self._face) > IN:
                    self._fail(seen, f"led back: {self.words}")
                else:
                    self._go(State.ALIGN, seen.now, "once more from before the port")
        if self.state in (State.INSERT, State.UNPLUG):
            self._hand.clock(seen, self._face)
        if self._hand.depth(seen, self._face) > IN:
            self.permission.felt(seen.now)
        if self.state is State.CHARGE and self._charged(car):
            self._end_charging(seen)  # nothing moves by that
        return Wish(Rest(self.words, permit=self._ask(seen)))

    # -- states ---------------------------------------------------------------------------------

    def _stand_by(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        there = np.abs(seen.joints.position - self._stand_by_joints).max() < 0.02
        self._ending = False
        if there and not self._way_out.kept:
            self.check.feel(self._hand.feeling, seen.now)
        else:
            self.check.leave()
        if self._way_out.kept and there:
            if self._late:
                self.words, self._late = self._how_it_ended, False
            self.words = self._way_out.forget() or self.words
        elif self._way_out.kept and self._in_state(seen) > self._patience:
            why = "" if seen.guard is None else seen.guard.reason
            self.words = f"is not back at its stand-by: {why or 'the arm does not get there'}"
            self._late = True
        if self._wanted and there and car is not None and car.parked:
            self._wanted = False
            self._looked = self._side = self._tries = self._again = 0
            self._waiting.forget()
            self.port = self._hand.answer = self._T_shown = None
            if self.finger is not None:
                self.finger.begin()
            self.visits.begin(Outcome(began=seen.now))
            self._go(State.FIND, seen.now)
        elif self._wanted and car is None:
            self.words = "waits: nothing is heard of the car"
        elif self._wanted and car is not None and not car.parked:
            self.words = "waits until the car is parked"
        # on the way home from a port its dark pocket is still the port's
        permit = None if there else self._ask(seen)
        return Wish(JointIntent("stand by", self._stand_by_joints, permit=permit))

    def _find(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From afar: which port, and about where."""
        self._hung = self._hand.feeling.pull  # the newest before the arm sets out
        if car is not None and car.port and car.port not in INLETS_OF[self.options.plug]:
            words = f"the car says that it has {car.port}: the {self.options.plug} does not fit"
            self._fail(seen, words)
            return Wish(JointIntent("stand by", self._stand_by_joints))
        look = self._looker.fresh(seen, self.options.far, self._begun(seen))
        if look is None and not self._looked:
            self.words = f"waits for pictures of {self.options.far}"
        if look is not None:
            self.words = ""
            self._looked += 1
            port = self._looker.of_ours(look)
            if port is not None:
                self._found(seen, port, look.stamp, self.options.far_sigma)
            elif self._looked >= self.options.looks:
                self._fail(seen, self._looker.why_none(look))
        if self.finger is not None and self.state is State.FIND:
            lid = self._looker.fresh_lid(seen, self.options.far, self._begun(seen))
            if lid is not None and lid.T_base_lid is not None:
                self._lid_found(seen, lid, self.options.far_sigma)
        return Wish(JointIntent("stand by", self._stand_by_joints), (self.options.far,))

    def _found(self, seen: Seen, port: SeenPort, stamp: float, sigma: float) -> None:
        wrong = self._impossible(port.T_base_port)
        if wrong:
            self._fail(seen, wrong)
            return
        self.port, self._sigma, self._looked = port, sigma, 0
        self.permission.see(port, stamp, sigma)
        if self._unkept(seen):
            return
        if math.isnan(self.outcome.found):
            self.visits.note(port=port.port, score=port.score, found=seen.now)
        second = self.state is State.FIND and self._T_near is not None
        self._on(seen, State.LOOK if second else State.APPROACH)

    def _look(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From near and off the axis, where the tilt shows."""
        o, port = self.options, self.port
        assert port is not None
        goal, there = self._from_near(seen, port.T_base_port, o.look_from, "look")
        if not there:
            return Wish(goal)
        look = self._looker.fresh(seen, o.near, self._begun(seen))
        if look is not None:
            self._looked += 1
            near = self._looker.of_ours(look)
            gap = math.inf
            if near is not None:
                gap = float(np.linalg.norm((near.T_base_port - port.T_base_port)[:3, 3]))
            if near is not None and gap < SAME and not near.doubtful:
                self._found(seen, near, look.stamp, o.near_sigma)
            elif self._looked >= o.looks:
                doubt = "its roll cannot be told"
                if near is None:
                    doubt = self._looker.why_none(look)
                elif gap >= SAME:
                    doubt = (
                        f"the port is {100 * gap:.0f} cm from where {o.far} saw it: "
                        "calibrate the cameras"
                    )
                self._fail(seen, f"second look: {doubt}")
            else:
                self._other_side(seen, "again from another side")
        elif self._in_state(seen) > 0.5 * o.patience:
            self.words = f"waits for pictures of {o.near}"
        return Wish(goal, (o.near,))

    def _approach(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """The plug before the port, looking along its axis."""
        assert self.port is not None
        T_plug = before_port(self.port.T_base_port, self.options.before)
        T_tip = T_plug @ inverse(self._hand.feeling.T_flange_plug) @ self._T_tip
        goal = PoseIntent(
            self._goal("approach"),
            T_tip,
            0.003,
            0.02,
            permit=self._ask(seen),
        )
        if reached(seen, goal.name) and self._rests(seen, 0.3):
            self._hand.feeling.hang()
            self.visits.note(approached=seen.now)
            wrong = "" if self._weight is None else self._hand.feeling.not_ours(self._weight)
            if wrong:
                self._fail(seen, wrong)
            elif not (self._hand.feeling.zero(seen.now) and self._unkept(seen)):
                self._go(State.ALIGN, seen.now)
        return Wish(goal)

    def _align(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Straight on until shortly before the face."""
        assert self.port is not None
        goal = before_port(self.port.T_base_port, self.options.start)
        if all(a < b for a, b in zip(apart(self._hand.plug(seen), goal), ARRIVED)):
            self._go(State.TARE, seen.now)
        return self._hand.straight(seen, goal, self.state.value)

    def _tare(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """At rest: what the sensor says now is no contact; then the way out is written down."""
        o, port = self.options, self.port
        assert port is not None
        if car is not None and (car.locked or car.charging):
            does = "charges" if car.charging else "locks its plug"
            self._fail(seen, f"the car says that it {does}, and the plug is not in it")
            return Wish(Rest("tares", permit=self._ask(seen)))
        if not self.permission.holds(seen.guard):
            reason = (
                ""
                if seen.guard is None or seen.guard.permit is None
                else (seen.guard.permit.reason)
            )
            self.words = f"waits for leave to touch: {reason}"
        elif self._rests(seen, o.settle):
            wrong = "" if self._weight is None else self._hand.feeling.not_ours(self._weight)
            if wrong:  # it was dropped, or its cable caught, on the way from the approach
                self._fail(seen, wrong)
            elif not self._hand.feeling.zero(seen.now):
                self._fail(seen, "the force sensor is silent or noisy: nobody would feel the port")
            elif not self._unkept(seen):
                law = PaperInsertion if o.mode == "paper" else Insertion
                self._hand.begin(law(self._law_options))
                self._tries += 1
                self.visits.note(out=False, tries=self._tries)
                self._go(State.INSERT, seen.now)
        return Wish(Rest("tares", permit=self._ask(seen)))

    def _insert(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        answer, wish = self._hand.by_force(seen, self.state.value, self._face)
        if answer is None:
            return wish
        if answer.depth < -IN and self._hand.aside(seen, self._face) > LED:
            self._fail(seen, "the plug was led aside")
            return wish
        self.words = _said(answer)
        if answer.phase is Phase.SEATED:
            self.visits.note(seated=True, plugged=seen.now)
            unkept = self._keep(plugged=True)
            self._told = "plugged"
            self.vehicle.tell("plugged", seen.now)
            words = f"{answer.words}; {unkept}" if unkept else answer.words
            self._go(State.CHARGE, seen.now, words)
        elif answer.phase is Phase.FAILED:
            self._fail(seen, f"plugging in: {answer.words}")
        return wish

    def _charge(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        self.permission.felt(seen.now)
        if self._charged(car):
            self._end_charging(seen)
            problem = "" if car is None else car.problem
            problem = problem or ("ended by hand" if self._ending else "")
            self.visits.note(charged=car is not None and car.enough)
            self.visits.blame(problem)
            if not self._holds_on(seen, car):
                self._begin_unplug(seen)
        elif car is None:
            self.words = NOT_HEARD
        elif not car.charging and self._in_state(seen) > RELAX:
            self._told = "plugged"
            self.vehicle.tell("plugged", seen.now)  # it has not heard; or we were killed meanwhile
            if self._in_state(seen) > self.options.patience:
                self.words = NOT_CHARGED
        elif self.words in (NOT_HEARD, NOT_CHARGED):
            self.words = ""
        if self._in_state(seen) < RELAX and self._hand.law is not None:
            self._along = GoingAlong()
            return self._hand.by_force(seen, self.state.value, self._face)[1]
        return self._go_along(seen) or Wish(Rest("charges", permit=self._ask(seen)))

    def _go_along(self, seen: Seen) -> Wish | None:
        """By force where its socket leads the plug: the car settles, is leaned on, is pushed."""
        if not isinstance(self._hand.law, Insertion):
            return None  # the paper's way stands, and so does who was killed meanwhile
        plug = self._hand.plug(seen)
        went = self._along.step(seen.now, self._hand.feeling.contact(seen.now), plug)
        if went is not None:
            self._port_went(seen, went)
        if not self._along.led(seen.now, plug):
            return None
        self.words = "the car moves: the plug goes along"
        return self._hand.by_force(seen, self.state.value, self._face)[1]

    def _port_went(self, seen: Seen, T: Pose) -> None:
        """The socket is where the plug is: what is asked for and what is on disk go along."""
        assert self.port is not None
        before = self.port.T_base_port
        self.port = replace(self.port, T_base_port=T @ before)
        self.permission.see(self.port, seen.now, self._sigma)
        unkept = self._keep(plugged=True)
        away = 1e3 * float(np.linalg.norm(self.port.T_base_port[:3, 3] - before[:3, 3]))
        self.words = f"the car moved by {away:.0f} mm and the plug went along"
        self.words = f"{self.words}; {unkept}" if unkept else self.words

    def _unplug(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        answer, wish = self._hand.by_force(seen, self.state.value, self._face)
        if answer is not None:
            self.words = _said(answer)
        if answer is not None and answer.phase is Phase.OUT:
            self.vehicle.tell("unplugged", seen.now)
            self.visits.note(out=True)
            self._go(State.LEAVE, seen.now, "unplugged")
        elif answer is not None and answer.phase is Phase.FAILED:
            self._go(State.STUCK, seen.now, f"unplugging: {answer.words}; help by hand")
        return wish

    def _held(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """A permit was lost in contact: the guard backs out; then out along the axis."""
        if self._rests(seen, 0.8) and self._in_state(seen) > 1.0:
            if self._lid_held:
                self._leave_lid(seen)
            elif self._hand.depth(seen, self._face) > IN:
                if car is not None and (car.locked or car.charging):
                    self._end_charging(seen)
                if not self._holds_on(seen, car):
                    self._begin_unplug(seen)
            else:
                self._go(State.LEAVE, seen.now, self.words)
        return Wish(Rest(self.words))

    def _leave(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Back along the axis; then once more, or to the stand-by."""
        assert self.port is not None
        goal = before_port(self.port.T_base_port, self.options.before)
        T = inverse(goal) @ self._hand.plug(seen)
        if T[2, 3] < 0.005:
            wrong = "" if self._weight is None else self._hand.feeling.not_ours(self._weight)
            self.visits.blame(f"out again, {wrong}" if wrong else "")
            self._out()
            again = self.outcome.problem and not self._ending and not self.outcome.seated
            if again and self._again + 1 < self.options.tries and self._T_near is not None:
                self._again += 1
                self.words = f"once more: {self.outcome.problem}"
                self.visits.note(problem="")
                self._looked, self._side = 0, self._side + 1
                self._go(State.LOOK, seen.now, self.words)
            else:
                self._finish(seen)
        return self._hand.straight(seen, goal, self.state.value)

    def _stuck(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Nobody can go on but a person.

        What holds the arm says where it is, for as long as it takes; a permit that grows old would
        be withdrawn, and the guard would back out, with the plug in its socket.
        """
        self.visits.blame(self.words)
        plugged = self.port is not None and self._hand.depth(seen, self._face) > IN
        held = plugged or (self.finger is not None and self.finger.touches(seen.now))
        if held:
            self.permission.felt(seen.now)
        return Wish(Rest(self.words, fault=True, permit=self._ask(seen) if held else None))


def _said(answer: Answer) -> str:
    """What the law does, in words."""
    return f"{answer.phase.value}: {answer.words}" if answer.words else answer.phase.value
