"""The plug in the arm's hand: where it is, how deep, and the velocities that move it."""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.feeling import Feeling
from armsight.charging.insert import Answer, Felt, Insertion
from armsight.charging.insert_paper import PaperInsertion
from armsight.charging.journal import Entry
from armsight.charging.moves import before_port, straight
from armsight.charging.permission import Permission
from armsight.charging.ports.table import PORTS
from armsight.charging.visit import Seen, State, StationOptions, Wish
from armsight.geometry.pose import inverse, make_pose
from armsight.motion.data import GuardMode
from armsight.motion.intents import Rest, VelocityIntent
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot

IN = 0.002
"""A plug that is deeper than this may be held by the socket [m]."""
LASTS = 0.15
"""A velocity is good for so long [s]."""
ASIDE = 0.05
"""A plug farther from the port's axis is not in it [m]."""


class PlugHand:
    """Moves the plug by velocities, in free air and by force.

    Args:
        robot: with the plug as its tool.
        options: of the station.
        permission: to touch.

    Attributes:
        feeling: what it feels, and how it hangs.
        law: of plugging in or out that is at work; answer: its newest.
    """

    def __init__(self, robot: Robot, options: StationOptions, permission: Permission) -> None:
        assert robot.tool is not None
        self._robot, self._options, self._permission = robot, options, permission
        self._depth = PORTS[options.plug].depth
        self.feeling = Feeling(robot.tool.T_flange_tcp, options.insert.admittance)
        self.law: Insertion | PaperInsertion | None = None
        self.answer: Answer | None = None

    def begin(self, law: Insertion | PaperInsertion) -> None:
        """Another law is at work from now on."""
        self.law, self.answer = law, None

    def plug(self, seen: Seen) -> Pose:
        """``T_base_plug`` by the joints and by how the plug hangs."""
        flange = flange_pose(self._robot, seen.joints.position)
        return np.asarray(flange @ self.feeling.T_flange_plug)

    def depth(self, seen: Seen, face: Pose) -> float:
        """Of the plug's front below the face [m], the mount's give taken in.

        Where nobody feels, it is at least as deep as the law knew last: pulled at, the hand is some
        centimetres before the plug that the car holds.

        Args:
            seen: newest.
            face: ``T_base_plug`` of a plug that touches the face.
        """
        T = self._before(seen, face)
        if float(np.linalg.norm(T[:2, 3])) > ASIDE:
            return -math.inf
        depth = float(T[2, 3]) + self.feeling.give(seen.now)
        if self.answer is not None and self.feeling.contact(seen.now) is None:
            depth = max(depth, self.answer.depth)
        return depth

    def aside(self, seen: Seen, face: Pose) -> float:
        """How far the plug is from the port's axis [m]."""
        return float(np.linalg.norm(self._before(seen, face)[:2, 3]))

    def _before(self, seen: Seen, face: Pose) -> Pose:
        """The plug in the frame of one that touches the face."""
        return np.asarray(inverse(face) @ self.plug(seen))

    def straight(self, seen: Seen, goal: Pose, name: str) -> Wish:
        """In free air towards a pose of the plug."""
        twist = straight(self.plug(seen), goal, self._options.speed)
        return self.moving(seen, twist, name)

    def by_force(self, seen: Seen, name: str, face: Pose) -> tuple[Answer | None, Wish]:
        """One step of the law; no answer where nobody feels.

        It is told where the guard holds the arm: somebody who comes between is no jam. It is bound
        to its way in free air as well: an arm that slid aside there missed the port by 5 cm.
        """
        held = seen.guard is not None and seen.guard.mode is GuardMode.STOPPED
        answer = self._step(seen, face, held)
        if answer is None:
            permit = self._permission.ask(seen.now, seen.guard)
            return None, Wish(Rest("the force sensor is silent", True, permit))
        self.answer = answer
        if answer.depth > IN:
            self._permission.felt(seen.now)
        return answer, self.moving(seen, answer.twist, name, bound=True)

    def clock(self, seen: Seen, face: Pose) -> None:
        """The law waits, and no time passes for it."""
        self._step(seen, face, True)

    def _step(self, seen: Seen, face: Pose, held: bool) -> Answer | None:
        """One step of the law; None where nobody feels."""
        assert self.law is not None
        wrench = self.feeling.contact(seen.now)
        if wrench is None:
            return None
        seat = face @ make_pose(None, (0.0, 0.0, self._depth))
        return self.law.step(Felt(seen.now, inverse(seat) @ self.plug(seen), wrench, held))

    def moving(self, seen: Seen, twist: Floats, name: str, bound: bool = False) -> Wish:
        """The (6,) twist of the plug in its axes, as a wish."""
        stamp = seen.joints.stamp
        permit = self._permission.ask(seen.now, seen.guard)
        tip = self.feeling.tip_twist(twist)
        return Wish(VelocityIntent(name, tip, "tcp", stamp, stamp + LASTS, permit, bound=bound))


def after_kill(entry: Entry, T_base_plug: Pose) -> tuple[State, str]:
    """Where a station goes on that was stopped (or killed) during a visit, and why, in words.

    Args:
        entry: what it wrote before.
        T_base_plug: where its plug is now.
    """
    T = inverse(before_port(entry.T_base_port, 0.0)) @ T_base_plug
    aside = float(np.linalg.norm(T[:2, 3]))
    if aside < ASIDE and T[2, 3] > IN and entry.tare is None:
        return State.STUCK, "stands as if in the car, where it had not been yet: look at the plug"
    if aside < ASIDE and T[2, 3] > IN:
        words = "was stopped with the plug in the car"
        return (State.CHARGE if entry.plugged else State.HELD), words
    if aside < 0.15 and T[2, 3] > -0.3:
        return State.LEAVE, "was stopped before the port"
    return State.STAND_BY, "was stopped with the plug out of the car"
