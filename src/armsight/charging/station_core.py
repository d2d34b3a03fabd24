"""What every state of the charging station needs: what it believes and holds, how it goes on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.charging.cable_way import cable_fault
from armsight.charging.eye import SeenPort
from armsight.charging.feeling import Feeling
from armsight.charging.going_along import GoingAlong
from armsight.charging.hand import IN, PlugHand
from armsight.charging.insert import Answer, Insertion
from armsight.charging.journal import Journal
from armsight.charging.lid_finger import LidFinger, LidSetup
from armsight.charging.looking import Looker
from armsight.charging.moves import SIDES, before_port, looking_pose
from armsight.charging.permission import Permission
from armsight.charging.plug_check import PlugCheck
from armsight.charging.ports.table import PORTS
from armsight.charging.vehicle import Vehicle, VehicleStatus
from armsight.charging.visit import NEAR, Outcome, Seen, State, StationOptions
from armsight.charging.visit_log import VisitLog
from armsight.charging.waiting import Waiting
from armsight.charging.way_out import WayOut
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.motion.intents import PoseIntent
from armsight.motion.permits import PermitRequest
from armsight.robots.robot import Robot

ARRIVED = (0.0015, math.radians(0.6))
"""A straight line has ended within this [m], [rad]."""
SAME = 0.06
"""A second look finds the same port, or lid, within this [m]."""
GRAVITY = 9.81
"""[m/s^2]"""


class StationCore:
    """One plug, one place for cars.

    Args:
        robot: with the plug as its tool; its TCP is the plug's nominal place.
        stand_by: (n,) where the arm waits, out of the cameras' view [rad].
        vehicle: the car that is, or will be, there.
        journal: where what is needed to come out is kept.
        options: how it works.
        T_flange_near: the near pair's left camera on the flange; None without one.
        contradiction: why no car can be plugged in whose port is at ``T_base_port``, in words;
            empty when one can.
        lid: the finger, and the lid that the car that is expected has; None without either.
        body: the expected car's, in its port's frame: no cable hangs in it.
        shows: asked for (n,) joints that hold the plug before the standing pair, the best first
            [rad]; answers None until the map knows what stands there.

    Attributes:
        state: what it is doing; words: why, or what is wrong.
        visits: how they went.
        port: what it believes of the port, or None.
        permission: what the guard is asked for.
        finger: at the lid; None where there is none.
        check: whether the plug is still the one that was calibrated.

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
        contradiction: Callable[[Pose], str] = lambda T_base_port: "",
        lid: LidSetup | None = None,
        body: Sequence[Solid] = (),
        shows: Callable[[], Sequence[JointVector] | None] = tuple,
    ) -> None:
        assert robot.tool is not None
        self.options = o = options or StationOptions()
        self._law_options = replace(o.insert, depth=PORTS[o.plug].depth)
        self._robot, self._stand_by_joints = robot, np.asarray(stand_by, float)
        self.vehicle, self._journal = vehicle, journal
        self._contradiction, self._body = contradiction, tuple(body)
        self._T_tip = robot.tool.T_flange_tcp
        self._weight = None if o.cable is None else GRAVITY * robot.tool.mass + o.cable
        self._T_near = T_flange_near if o.mode == "ours" else None
        self._lid_setup = lid
        self._shows = shows
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen; only the journal is believed."""
        self.visits = VisitLog()
        self.port: SeenPort | None = None
        self.words = ""
        self.permission = Permission(self.options)
        self._hand = PlugHand(self._robot, self.options, self.permission)
        self.finger: LidFinger | None = None
        if self._lid_setup is not None:
            feeling = self._hand.feeling
            self.finger = LidFinger(self._lid_setup, self._T_tip, feeling, self.options)
        self._looker = Looker(self.options)
        self.check = PlugCheck(self.options.plug, self._weight)
        self.state = State.STAND_BY
        self._way_out = WayOut(self._journal, self.options.plug)
        self._wanted = self._ending = False
        self._since: float | None = None
        self._looked = self._side = self._tries = self._again = self._goals = 0
        self._along = GoingAlong()
        self._told, self._told_at = "", 0.0
        self._lid_held = self._late = False
        self._waiting = Waiting(self.options)
        self._T_shown: Pose | None = None
        self._hung = math.nan  # pulled at the plug when the visit began [N]
        self._sigma = self.options.far_sigma  # of the port's place, besides what it says itself

    @property
    def outcomes(self) -> list[Outcome]:
        """Of all visits that have ended."""
        return self.visits.ended

    @property
    def outcome(self) -> Outcome:
        """Of the newest visit."""
        return self.visits.outcome

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
        if self._wanted and self.state is State.STAND_BY:
            self.words = ""
        self._wanted, self._ending = False, True

    @property
    def busy(self) -> bool:
        """Whether a visit is under way or wanted, or the arm is still to come home from one."""
        return self._way_out.kept or self._wanted or self.state is not State.STAND_BY

    # -- for its states -------------------------------------------------------------------------

    def _go(self, state: State, now: float, words: str = "") -> None:
        self.state, self._since, self.words = state, now, words
        self._waiting.give_up()
        self._goals += 1

    def _fail(self, seen: Seen, problem: str) -> None:
        """What went wrong is said; the plug comes out, the arm leaves."""
        self.visits.blame(problem)
        if self.state is State.LID_WORK and self.finger is not None:
            self.finger.work("leave")
            self._go(State.LID_AWAY, seen.now, problem)
        elif self.port is None or self.state not in NEAR:
            self._finish(seen)
        elif self._hand.depth(seen, self._face) > IN:
            self._begin_unplug(seen)
        else:
            self._go(State.LEAVE, seen.now, problem)

    def _finish(self, seen: Seen) -> None:
        lid = self.finger
        if lid is not None and lid.opened and not lid.shutting and lid.T_base_lid is not None:
            lid.shutting = True
            exposure = self.permission.exposure
            sigma = self.options.near_sigma
            self.permission.see_lid(lid.T_base_lid, lid.covariance, exposure, sigma)
            self._go(State.LID_BEFORE, seen.now, "shuts the lid")
            return
        self.visits.end(seen.now)
        self._go(State.STAND_BY, seen.now, self._how_it_ended)

    @property
    def _how_it_ended(self) -> str:
        """The newest visit, in words."""
        good = "charged, and the plug is out again" if self.outcome.charged else ""
        return self.outcome.problem or good

    def _charged(self, car: VehicleStatus | None) -> bool:
        """Whether charging shall end: by the car, or by the button."""
        return self._ending or (car is not None and bool(car.enough or car.problem))

    def _end_charging(self, seen: Seen) -> None:
        """Tell the car, once a visit."""
        if self._told != "stop":
            self.vehicle.tell("stop", seen.now)
            self._told, self._told_at = "stop", seen.now

    def _holds_on(self, seen: Seen, car: VehicleStatus | None) -> bool:
        """Whether the car holds the plug, or charges, though it was told: nothing is pulled then.

        One that never lets go is somebody's to help.
        """
        if car is None or not (car.locked or car.charging):
            return False
        if seen.now - self._told_at > self.options.patience:
            words = "the car still locks the plug: unlock it at the car"
            if not car.locked:
                words = "the car says that it still charges: end it at the car"
            self._go(State.STUCK, seen.now, words)
        return True

    def _begin_unplug(self, seen: Seen) -> None:
        if self.outcome.seated:
            self._end_charging(seen)  # whyever it comes out: contacts do not part under load
        self._hand.begin(Insertion(self._law_options, out=True))
        self._go(State.UNPLUG, seen.now, self.words)

    def _out(self) -> None:
        """The plug is out, the finger away: all that is left is the way home."""
        self.words = self._keep() or self.words
        self.visits.note(out=True)

    def _unkept(self, seen: Seen) -> bool:
        """Whether the way out could not be written down: then nothing goes in."""
        problem = self._keep()
        if problem:
            self._fail(seen, f"does not plug in: {problem}")
        return bool(problem)

    @property
    def port_covariance(self) -> Floats:
        """(6, 6) of where the port is in ``base``, in its axes [m], [rad]; zeros without a port.

        It is what the look says of itself, and what arm and pair add to that.
        """
        if self.port is None:
            return np.zeros((6, 6))
        return np.asarray(self.port.covariance + np.diag([self._sigma**2] * 3 + [0.0] * 3))

    def _keep(self, plugged: bool = False, at_lid: bool = False) -> str:
        """Write the way out down; why that cannot be, in words."""
        assert self.port is not None
        lid = self.finger
        T_lid = lid.T_base_lid if lid is not None and (lid.opened or at_lid) else None
        six = self.port_covariance
        port = replace(self.port, covariance=six)
        return self._way_out.keep(port, self._hand.feeling, plugged, T_lid, at_lid)

    @property
    def _face(self) -> Pose:
        """``T_base_plug`` of a plug that touches the port's face."""
        assert self.port is not None
        return before_port(self.port.T_base_port, 0.0)

    @property
    def lid_open(self) -> bool:
        """Whether a lid stands open that this station has opened, and is not worked at now."""
        lid = self.finger
        working = self.state in (State.LID_WORK, State.LID_AWAY)
        return lid is not None and lid.opened and not working

    @property
    def expected_lid(self) -> Pose | None:
        """Where a lid that was seen in this visit is, to be looked at again; else None."""
        near = self.state is State.LID_LOOK
        return self.finger.T_base_lid if near and self.finger is not None else None

    @property
    def expected_port(self) -> Pose | None:
        """``T_base_port`` of the port that is being looked at from near; else None."""
        near = self.state is State.LOOK and self.port is not None
        return self.port.T_base_port if near and self.port is not None else None

    @property
    def shown(self) -> Pose | None:
        """``T_base_plug`` of the plug while it is shown to the standing pair; else None."""
        return self._T_shown if self.state is State.SHOW else None

    @property
    def _patience(self) -> float:
        """For this state [s]."""
        at_lid = self.state in (State.LID_WORK, State.LID_AWAY)
        return self.options.lid_patience if at_lid else self.options.patience

    def _from_near(
        self, seen: Seen, T_base_target: Pose, distance: float, what: str
    ) -> tuple[PoseIntent, bool]:
        """The goal that has the near pair look at something, and whether the arm is there.

        A side that it does not get to in half its patience is given up for the next one.
        """
        o = self.options
        assert self._T_near is not None
        T_camera = looking_pose(T_base_target, distance, o.look_aside, self._side)
        T_tip = T_camera @ inverse(self._T_near) @ self._T_tip
        goal = PoseIntent(self._goal(what), T_tip, 0.005, 0.02, permit=self._ask(seen))
        there = reached(seen, goal.name)
        if not there and self._in_state(seen) > 0.5 * o.patience and self._side + 1 < len(SIDES):
            self._other_side(seen, "from another side")
        return goal, there

    def _other_side(self, seen: Seen, words: str) -> None:
        self._side += 1
        self._go(self.state, seen.now, words)

    def possible(self, T_base_port: Pose) -> bool:
        """Whether a port can be at a pose, as far as this station can tell; from any thread."""
        return not self._impossible(T_base_port)

    def _impossible(self, T_base_port: Pose) -> str:
        """Why a port cannot be there, or nobody can plug in, in words; empty when that can be."""
        away = float(np.linalg.norm(T_base_port[:3, 3]))
        if away > self.options.reach:
            return f"the port is {away:.2f} m from the base: out of reach"
        other = self._contradiction(T_base_port)
        if other:
            return other
        cable = None if self._robot.tool is None else self._robot.tool.cable
        return "" if cable is None else cable_fault(cable, T_base_port, self._body)

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


def reached(seen: Seen, name: str) -> bool:
    """Whether the goal of this name was reached."""
    guard = seen.guard
    return guard is not None and guard.reached and guard.goal == name
