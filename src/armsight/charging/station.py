"""The charging station: one visit after the other, as a state machine that answers with intents.

Find the port from afar, look again from near, approach, align, plug in by force, charge, unplug,
stand by. It never sees the arm: what it wants are intents to the guard, and near the port a permit
to touch it with the plug. What is needed to come out is on disk before the plug goes in; a station
that finds that entry when it starts brings the plug out first.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.charging.eye import SeenPort
from armsight.charging.feeling import Feeling
from armsight.charging.hand import IN, PlugHand, after_kill
from armsight.charging.insert import Answer, Insertion, Phase
from armsight.charging.insert_paper import PaperInsertion
from armsight.charging.journal import Entry, Journal, JournalError
from armsight.charging.looking import Looker
from armsight.charging.moves import SIDES, apart, before_port, looking_pose
from armsight.charging.permission import Permission
from armsight.charging.ports.table import PORTS
from armsight.charging.vehicle import Vehicle, VehicleStatus
from armsight.charging.visit import IN_CONTACT, NEAR, Outcome, Seen, State, StationOptions, Wish
from armsight.geometry.pose import inverse
from armsight.motion.intents import JointIntent, PoseIntent, Rest
from armsight.motion.permits import PermitRequest
from armsight.robots.robot import Robot

ARRIVED = (0.0015, math.radians(0.6))
"""A straight line has ended within this [m], [rad]."""
RELAX = 1.5
"""After seating the law lets the force go down for so long [s]."""
SAME = 0.06
"""A second look finds the same port within this [m]."""


class Station:
    """One plug, one place for cars.

    Args:
        robot: with the plug as its tool; its TCP is the plug's nominal place.
        stand_by: (n,) where the arm waits, out of the cameras' view [rad].
        vehicle: the car that is, or will be, there.
        journal: where what is needed to come out is kept.
        options: how it works.
        T_flange_near: the near pair's left camera on the flange; None without one.

    Attributes:
        state: what it is doing; words: why, or what is wrong.
        outcomes: of all visits that have ended; outcome: of the newest.
        port: what it believes of the port, or None.
        permission: what the guard is asked for.

    Raises:
        JournalError: there is a journal that cannot be believed.
    """

    def __init__(
        self,
        robot: Robot,
        stand_by: JointVector,
        vehicle: Vehicle,
        journal: Journal,
        options: StationOptions | None = None,
        T_flange_near: Pose | None = None,
    ) -> None:
        assert robot.tool is not None
        self.options = o = options or StationOptions()
        self._law_options = replace(o.insert, depth=PORTS[o.plug].depth)
        self._robot, self._stand_by_joints = robot, np.asarray(stand_by, float)
        self.vehicle, self._journal = vehicle, journal
        self._T_tip = robot.tool.T_flange_tcp
        self._T_near = T_flange_near if o.mode == "ours" else None
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen; only the journal is believed."""
        self.outcomes: list[Outcome] = []
        self.outcome = Outcome()
        self.port: SeenPort | None = None
        self.words = ""
        self.permission = Permission(self.options)
        self._hand = PlugHand(self._robot, self.options, self.permission)
        self._looker = Looker(self.options)
        self.state = State.STAND_BY
        self._entry = self._journal.read()
        self._wanted = self._ending = False
        self._since: float | None = None
        self._looked = self._side = self._tries = self._goals = 0
        self._told = ""

    @property
    def feeling(self) -> Feeling:
        """What the plug feels."""
        return self._hand.feeling

    @property
    def answer(self) -> Answer | None:
        """Newest of the law of plugging in and out, or None."""
        return self._hand.answer

    # -- from outside ---------------------------------------------------------------------------

    def begin(self) -> None:
        """A visit is wanted."""
        self._wanted = True

    def end(self) -> None:
        """Whatever is under way shall end: come out, stand by."""
        self._wanted, self._ending = False, True

    @property
    def busy(self) -> bool:
        """Whether a visit is under way or wanted, or one that was killed has to be ended."""
        killed = self._entry is not None
        return killed or self._wanted or self.state is not State.STAND_BY

    def step(self, seen: Seen) -> Wish:
        """One round."""
        if self._since is None:
            self._since = seen.now
        self._hand.feeling.take(seen)
        self._looker.take(seen)
        if self._entry is not None:
            self._recover(seen, self._entry)
        car = self.vehicle.status(seen.now)
        self._watch(seen, car)
        wish: Wish = getattr(self, f"_{self.state.name.lower()}")(seen, car)
        return wish

    # -- what may end any state -----------------------------------------------------------------

    def _watch(self, seen: Seen, car: VehicleStatus | None) -> None:
        """Lost permits, cars that move, states that take too long, a wish to end."""
        state, lost = self.state, self.permission.lost(seen.guard)
        if state in IN_CONTACT and lost:
            self.outcome = replace(self.outcome, problem=self.outcome.problem or lost)
            self._go(State.HELD, seen.now, lost)
            return
        if state in (State.STAND_BY, State.STUCK, State.HELD):
            return
        if car is not None and not car.parked and state not in (State.UNPLUG, State.LEAVE):
            self._fail(seen, car.problem or "the car moves")
        elif state is State.CHARGE:
            return
        elif self._ending and state not in (State.UNPLUG, State.LEAVE):
            self._fail(seen, "ended by hand")
        elif self._in_state(seen) > self.options.patience:
            why = seen.guard.reason if seen.guard is not None and seen.guard.reason else ""
            words = f"{state.value}: no end after {self.options.patience:.0f} s"
            words = f"{words} ({why})" if why else words
            if state is State.LEAVE:
                self._go(State.STUCK, seen.now, words)
            else:
                self._fail(seen, words)

    def _recover(self, seen: Seen, entry: Entry) -> None:
        """A station that was killed: where is the plug, and what now?"""
        self._entry = None
        if entry.plug != self.options.plug:
            self._go(State.STUCK, seen.now, f"the journal is of a {entry.plug}; look at the plug")
            return
        self.port = SeenPort(entry.port, 1.0, entry.T_base_port, np.zeros((6, 6)), False)
        self.permission.see(self.port, seen.now, self.options.near_sigma)
        self._hand.feeling.T_flange_plug, self._hand.feeling.tare = entry.T_flange_plug, entry.tare
        self.outcome = Outcome(port=entry.port, began=seen.now, out=False, seated=entry.plugged)
        state, words = after_kill(entry, self._hand.plug(seen))
        if state is State.STAND_BY:
            self._out(seen)
        self._go(state, seen.now, words)

    # -- states ---------------------------------------------------------------------------------

    def _stand_by(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        there = np.abs(seen.joints.position - self._stand_by_joints).max() < 0.02
        self._ending = False
        if self._wanted and there and car is not None and car.parked:
            self._wanted = False
            self._looked = self._side = self._tries = 0
            self.port = self._hand.answer = None
            self.outcome = Outcome(began=seen.now)
            self._go(State.FIND, seen.now)
        elif self._wanted and car is not None and not car.parked:
            self.words = "waits until the car is parked"
        # on the way home from a port its dark pocket is still the port's
        permit = None if there else self._ask(seen)
        return Wish(JointIntent("stand by", self._stand_by_joints, permit=permit))

    def _find(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From afar: which port, and about where."""
        look = self._looker.fresh(seen, self.options.far, self._begun(seen))
        if look is not None:
            self._looked += 1
            port = self._looker.of_ours(look)
            if port is not None:
                self._found(seen, port, look.stamp, self.options.far_sigma)
            elif self._looked >= self.options.looks:
                self._fail(seen, self._looker.why_none(look))
        return Wish(JointIntent("stand by", self._stand_by_joints), (self.options.far,))

    def _found(self, seen: Seen, port: SeenPort, stamp: float, sigma: float) -> None:
        away = float(np.linalg.norm(port.T_base_port[:3, 3]))
        if away > self.options.reach:
            self._fail(seen, f"the port is {away:.2f} m from the base: out of reach")
            return
        self.port, self._looked = port, 0
        self.permission.see(port, stamp, sigma)
        if math.isnan(self.outcome.found):
            self.outcome = replace(self.outcome, port=port.port, score=port.score, found=seen.now)
        second = self.state is State.FIND and self._T_near is not None
        self._go(State.LOOK if second else State.APPROACH, seen.now)

    def _look(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """From near and off the axis, where the tilt shows."""
        o, port = self.options, self.port
        assert port is not None
        assert self._T_near is not None
        T_camera = looking_pose(port.T_base_port, o.look_from, o.look_aside, self._side)
        T_tip = T_camera @ inverse(self._T_near) @ self._T_tip
        goal = PoseIntent(self._goal("look"), T_tip, 0.005, 0.02, permit=self._ask(seen))
        if not _reached(seen, goal.name):
            if self._in_state(seen) > 0.5 * o.patience and self._side + 1 < len(SIDES):
                self._side += 1
                self._go(State.LOOK, seen.now, "from another side")
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
                doubt = (
                    "its roll cannot be told" if near is not None else self._looker.why_none(look)
                )
                self._fail(seen, f"second look: {doubt}")
            else:
                self._side += 1
                self._go(State.LOOK, seen.now, "again from another side")
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
        if _reached(seen, goal.name) and self._rests(seen, 0.3):
            self._hand.feeling.hang()
            self.outcome = replace(self.outcome, approached=seen.now)
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
        if not self.permission.holds(seen.guard):
            reason = (
                ""
                if seen.guard is None or seen.guard.permit is None
                else (seen.guard.permit.reason)
            )
            self.words = f"waits for leave to touch: {reason}"
        elif self._rests(seen, o.settle):
            if not self._hand.feeling.zero(seen.now):
                self._fail(seen, "the force sensor is silent or noisy: nobody would feel the port")
            elif self._kept(seen, False):
                law = PaperInsertion if o.mode == "paper" else Insertion
                self._hand.law = law(self._law_options)
                self._tries += 1
                self.outcome = replace(self.outcome, out=False, tries=self._tries)
                self._go(State.INSERT, seen.now)
        return Wish(Rest("tares", permit=self._ask(seen)))

    def _insert(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        answer, wish = self._hand.by_force(seen, self.state.value, self._face)
        if answer is None:
            return wish
        self.words = _said(answer)
        if answer.phase is Phase.SEATED:
            self.outcome = replace(self.outcome, seated=True, plugged=seen.now)
            self._kept(seen, True)
            self.vehicle.tell("plugged", seen.now)
            self._go(State.CHARGE, seen.now, answer.words)
        elif answer.phase is Phase.FAILED:
            self._fail(seen, f"plugging in: {answer.words}")
        return wish

    def _charge(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        self.permission.felt(seen.now)
        problem = "" if car is None else car.problem
        enough = car is not None and car.enough
        if enough or problem or self._ending:
            if self._told != "stop":
                self.vehicle.tell("stop", seen.now)
                self._told = "stop"
            problem = problem or ("ended by hand" if self._ending else "")
            self.outcome = replace(
                self.outcome, charged=enough, problem=self.outcome.problem or problem
            )
            if car is None or not car.locked:
                self._told = ""
                self._begin_unplug(seen)
        elif car is not None and not car.charging and self._in_state(seen) > RELAX:
            self.vehicle.tell("plugged", seen.now)  # it has not heard; or we were killed meanwhile
        if self._in_state(seen) < RELAX and self._hand.law is not None:
            return self._hand.by_force(seen, self.state.value, self._face)[1]
        return Wish(Rest("charges", permit=self._ask(seen)))

    def _unplug(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        answer, wish = self._hand.by_force(seen, self.state.value, self._face)
        if answer is not None:
            self.words = _said(answer)
        if answer is not None and answer.phase is Phase.OUT:
            self.vehicle.tell("unplugged", seen.now)
            self._out(seen)
            self._go(State.LEAVE, seen.now, "unplugged")
        elif answer is not None and answer.phase is Phase.FAILED:
            self._go(State.STUCK, seen.now, f"unplugging: {answer.words}; help by hand")
        return wish

    def _held(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """A permit was lost in contact: the guard backs out; then out along the axis."""
        if self._rests(seen, 0.8) and self._in_state(seen) > 1.0:
            if self._hand.depth(seen, self._face) > IN:
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
            self._out(seen)
            again = self.outcome.problem and not self._ending and not self.outcome.seated
            if again and self._tries < self.options.tries and self._T_near is not None:
                self.words = f"once more: {self.outcome.problem}"
                self.outcome = replace(self.outcome, problem="")
                self._looked, self._side = 0, self._side + 1
                self._go(State.LOOK, seen.now, self.words)
            else:
                self._finish(seen)
        return self._hand.straight(seen, goal, self.state.value)

    def _stuck(self, seen: Seen, car: VehicleStatus | None) -> Wish:
        """Nobody can go on but a person."""
        if not self.outcome.problem:
            self.outcome = replace(self.outcome, problem=self.words)
        return Wish(Rest(self.words, fault=True, permit=self._ask(seen)))

    # -- inside ---------------------------------------------------------------------------------

    def _go(self, state: State, now: float, words: str = "") -> None:
        self.state, self._since, self.words = state, now, words
        self._goals += 1

    def _fail(self, seen: Seen, problem: str) -> None:
        """What went wrong is said; the plug comes out, the arm leaves."""
        self.outcome = replace(self.outcome, problem=self.outcome.problem or problem)
        if self.port is None or self.state not in NEAR:
            self._finish(seen)
        elif self._hand.depth(seen, self._face) > IN:
            self._begin_unplug(seen)
        else:
            self._go(State.LEAVE, seen.now, problem)

    def _finish(self, seen: Seen) -> None:
        self.outcome = replace(self.outcome, ended=seen.now)
        self.outcomes.append(self.outcome)
        self._go(State.STAND_BY, seen.now, self.outcome.problem)

    def _begin_unplug(self, seen: Seen) -> None:
        self._hand.law = Insertion(self._law_options, out=True)
        self._go(State.UNPLUG, seen.now, self.words)

    def _kept(self, seen: Seen, plugged: bool) -> bool:
        """Write down how to come out; what cannot be written is not begun."""
        assert self.port is not None
        assert self._hand.feeling.tare is not None
        entry = Entry(
            self.port.port,
            self.options.plug,
            self.port.T_base_port,
            self._hand.feeling.T_flange_plug,
            self._hand.feeling.tare,
            plugged,
        )
        try:
            self._journal.write(entry)
        except JournalError as error:
            if not plugged:
                self._fail(seen, f"does not plug in: {error}")
            return False
        return True

    def _out(self, seen: Seen) -> None:
        """The plug is out: nothing is under way any more."""
        try:
            self._journal.clear()
        except JournalError as error:
            self.words = str(error)
        self.outcome = replace(self.outcome, out=True)

    @property
    def _face(self) -> Pose:
        """``T_base_plug`` of a plug that touches the port's face."""
        assert self.port is not None
        return before_port(self.port.T_base_port, 0.0)

    def _ask(self, seen: Seen) -> PermitRequest | None:
        return self.permission.ask(seen.now, seen.guard)

    def _rests(self, seen: Seen, seconds: float) -> bool:
        return self._looker.rests(seen, self._begun(seen), seconds)

    def _goal(self, what: str) -> str:
        return f"{what} {self._goals}"

    def _begun(self, seen: Seen) -> float:
        """When this state began [s]."""
        return seen.now if self._since is None else self._since

    def _in_state(self, seen: Seen) -> float:
        return seen.now - self._begun(seen)


def _reached(seen: Seen, name: str) -> bool:
    guard = seen.guard
    return guard is not None and guard.reached and guard.goal == name


def _said(answer: Answer) -> str:
    """What the law does, in words."""
    return f"{answer.phase.value}: {answer.words}" if answer.words else answer.phase.value
