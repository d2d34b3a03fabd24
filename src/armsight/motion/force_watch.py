"""Every reading of the force sensor, judged: how hard is something pressed, and can it be believed.

What the sensor says is the weight and the inertia of what it carries, its own error, and what
touches. Weight and inertia follow from the joints; the error is what was left over while nothing
was near (its mean over the last half second, which it follows no faster than a sensor drifts), and
is kept as it was when the arm came to what it may touch. What remains is contact.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, JointVector, Vector3
from armsight.devices.data import Wrench
from armsight.geometry.pose import cross
from armsight.motion.permits import Permit
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import SprungTip, press_depth, pressing_force

STALE = 0.02
"""A reading older than this says nothing of now [s]."""
TARED_OVER = 0.5
"""The sensor's error is the mean over this time without contact [s]."""
LEAD = 0.15
"""What presses and grows is judged by what it will be after this time [s]: until a command has
acted (a tick, the drives, the filters) and the arm has come to rest."""
GIVING, LASTING = 0.06, 0.1
"""A hand gives way after the first blow, whose growth counts for this time ahead only [s]; what has
grown for LASTING [s] is no blow: it goes on growing until the arm stands, or the hand does."""
SLIPS = 0.8
"""Friction of a bare tip on skin. Where it slips, what held it sideways is let go of at once, and
rings: up to (1 + SLIPS) times what it was pressed with. A hand is held with that much less."""
SMOOTH = 0.15
"""Share of a new rate of the force in the one that is used: readings are noisy."""
FELT = 0.5
"""Less force than this is noise [N]."""
SAMPLES = 10
"""Fewer readings are no mean."""
DRIFTS = (0.3, 0.03)
"""The error of a sensor changes no faster than this: force [N/s], torque [N m/s]. Who presses
slowly on what the map does not show would else be taken for one."""
FROZEN, MOVED = 0.25, 0.002
"""Every sensor is noisy, and feels its tool turn: one that says the very same for so long [s] while
a joint moves by more than this [rad] is dead, however fresh its stamps."""
BIAS = (60.0, 6.0)
"""A sensor that errs by more than this cannot be believed: force [N], torque [N m]."""


def held_force(force: float) -> float:
    """With how much [N] a hand may be pressed for long so that a slip stays below a force [N]."""
    return force / (1.0 + SLIPS)


@dataclass(frozen=True)
class Felt:
    """Contact by one reading: at ``stamp`` [s], force [N] and torque about the TCP [N m]."""

    stamp: float
    force: Vector3
    torque: Vector3


class ForceWatch:
    """Judges the readings of one sensor.

    Args:
        robot: with its tool.
        gravity: (3,) in ``base`` [m/s^2].
    """

    def __init__(self, robot: Robot, gravity: Sequence[float]) -> None:
        self._robot = robot
        self._gravity = np.asarray(gravity, float)
        tool = robot.tool
        self._mass = 0.0 if tool is None else tool.mass
        self._center = np.zeros(3) if tool is None else np.asarray(tool.center_of_mass, float)
        self._tip = np.zeros(3) if tool is None else tool.T_flange_tcp[:3, 3]
        self._free: deque[tuple[float, Floats]] = deque()
        self._sum: Floats = np.zeros(6)
        self._bias: Floats | None = None
        self._tared = self._first = -math.inf
        self._new: list[Felt] = []
        self._load: Floats = np.zeros(6)
        self._stamp = -math.inf
        self._mean = (-math.inf, 0.0)
        self._rate = 0.0
        self._rates: deque[tuple[float, float, float]] = deque()
        self._push: Vector3 | None = None
        self._told: Floats = np.full(6, np.nan)
        self._since, self._stood = -math.inf, np.zeros(robot.n)  # when it said something new
        self._frozen = False

    def turn_back(self, back: float) -> None:
        """The clock was turned back by so much [s]: what the sensor errs by is what it was."""
        self._free = deque((at - back, rest) for at, rest in self._free)
        self._rates = deque((at - back, rate, force) for at, rate, force in self._rates)
        self._new = [replace(felt, stamp=felt.stamp - back) for felt in self._new]
        self._tared, self._first, self._stamp, self._since = (
            at - back for at in (self._tared, self._first, self._stamp, self._since)
        )
        self._mean = (self._mean[0] - back, self._mean[1])

    @property
    def push(self) -> Vector3 | None:
        """(3,) mean force on the arm by the newest readings, in ``base`` [N]; None without any."""
        return self._push

    @property
    def pressed(self) -> float:
        """Greatest force among the newest readings [N]; NaN when there is none."""
        return max((float(np.linalg.norm(f.force)) for f in self._new), default=math.nan)

    def take(
        self,
        readings: Sequence[Wrench],
        q: JointVector,
        touching: bool,
        pull: Vector3 | None = None,
    ) -> None:
        """Take in what came since the last tick.

        Args:
            readings: in the flange's frame, oldest first.
            q: (n,) joints at about their time [rad].
            touching: the arm may be in contact; what it feels is no error of the sensor.
            pull: (3,) acceleration of the tool's centre of mass in ``base`` [m/s^2]; None for rest.
        """
        if not readings:
            return
        before, self._new = self._mean, []
        R = flange_pose(self._robot, q)[:3, :3]
        falls = self._gravity if pull is None else self._gravity - pull
        weight = R.T @ (self._mass * falls)
        self._load = np.concatenate([weight, cross(self._center, weight)])
        for reading in readings:
            told = np.concatenate([reading.force, reading.torque]).astype(float)
            if not (np.isfinite(told).all() and reading.stamp > self._stamp):
                continue  # what is no number, and no newer, is as good as silence
            self._stamp = reading.stamp
            self._note_repeats(told, q)
            rest = told - self._load
            if not touching:
                self._free.append((reading.stamp, rest))
                self._sum += rest
                while self._free[0][0] < reading.stamp - TARED_OVER:
                    self._sum -= self._free.popleft()[1]
                if len(self._free) >= SAMPLES:  # else what was known before still is
                    self._tare(self._sum / len(self._free))
            error = np.zeros(6) if self._bias is None else self._bias
            self._new.append(self._felt(reading.stamp, rest - error))
        if self._new:
            mean = np.mean([f.force for f in self._new], axis=0)
            self._push = np.asarray(R @ mean)
            self._mean = (float(np.mean([f.stamp for f in self._new])), float(np.linalg.norm(mean)))
            passed = self._mean[0] - before[0]
            rate = (self._mean[1] - before[1]) / passed if 1e-4 < passed < 0.1 else 0.0
            self._rate += SMOOTH * (rate - self._rate)
            self._rates.append((self._mean[0], self._rate, self._mean[1]))
            while self._rates[0][0] < self._mean[0] - LASTING:
                self._rates.popleft()

    def _note_repeats(self, told: Floats, q: JointVector) -> None:
        """Whether (6,) is what it says again and again, though the arm moves."""
        if not np.array_equal(told, self._told):
            self._told, self._since, self._stood = told, self._stamp, np.array(q, float)
            self._frozen = False
        elif self._stamp - self._since > FROZEN:
            self._frozen |= bool(np.abs(q - self._stood).max() > MOVED)

    def know(self, tare: Floats) -> bool:
        """What the sensor said before the contact in which the arm stands, if that can be.

        Args:
            tare: (6,) force and torque in its axes, the arm as it stood then [N], [N m].

        Returns:
            Whether it was taken over: what errs by more than it may is not.
        """
        bias = np.asarray(tare, float) - self._load
        if not self._new or _errs(bias):
            return False
        hidden = self._felt(0.0, (np.zeros(6) if self._bias is None else self._bias) - bias)
        self._new = [
            replace(felt, force=felt.force + hidden.force, torque=felt.torque + hidden.torque)
            for felt in self._new
        ]
        self._bias, self._tared, self._first = bias, self._stamp, self._stamp - TARED_OVER
        self._free.clear()
        self._sum = np.zeros(6)
        self._mean, self._rate = (-math.inf, 0.0), 0.0  # it was pressed so all the time
        self._rates.clear()
        return True

    def _felt(self, stamp: float, contact: Floats) -> Felt:
        """(6,) of contact at the flange, its torque taken about the TCP."""
        return Felt(stamp, contact[:3], contact[3:] - cross(self._tip, contact[:3]))

    def _tare(self, mean: Floats) -> None:
        """The error goes to (6,) what was left over lately, as far as it may have drifted."""
        passed, self._tared = min(self._stamp - self._tared, TARED_OVER), self._stamp
        if self._bias is None:
            self._first = self._stamp
        if self._bias is None or self._stamp < self._first + TARED_OVER:
            self._bias = mean
            return
        most = passed * np.repeat(DRIFTS, 3)
        self._bias = self._bias + np.clip(mean - self._bias, -most, most)

    def fault(self, now: float) -> str:
        """Why the sensor cannot be believed at ``now`` [s], in words; empty when it can."""
        if not math.isfinite(self._stamp):
            return "no force sensor says anything"
        age = now - self._stamp
        if age > STALE:
            return f"the force sensor has been silent for {1e3 * age:.0f} ms"
        if self._frozen:
            return "the force sensor repeats itself while the arm moves"
        if self._bias is None:
            return "the force sensor has not been read without contact yet"
        if _errs(self._bias):
            force, torque = np.linalg.norm(self._bias[:3]), np.linalg.norm(self._bias[3:])
            return f"the force sensor says {force:.0f} N and {torque:.1f} N m without contact"
        return ""

    def excess(
        self,
        permit: Permit,
        deeper: float = 0.0,
        gives: tuple[float, SprungTip] | None = None,
        foretold: bool = True,
    ) -> str:
        """What of the newest readings is above a permit, in words; empty when nothing is.

        A force that grows counts as it will be when the arm could stand. A spring gives way softly
        to the end of its travel, and then no more: of a tip on one it is the depth that grows on.

        Args:
            permit: that holds.
            deeper: so much farther the tip is pressed in until the arm can stand [m].
            gives: stiffness of what is touched [N/m], and the tip on springs that alone may touch
                it; None where nothing of the arm gives way.
            foretold: what will be pressed counts, too; else what is pressed alone, since nothing
                that may be touched is so near.
        """
        rate = self._rate if foretold else 0.0
        grows = LEAD * rate
        if permit.kind == "hand":
            lasting = min((rate for _, rate, _ in self._rates), default=0.0)
            lasting = max(lasting, 0.0) if foretold else 0.0
            grows = max(GIVING * rate, LEAD * lasting)
            held = min((force for _, _, force in self._rates), default=0.0)
            if held + LEAD * lasting > held_force(permit.force):
                return (
                    f"pressed with {held:.1f} N for {LASTING:g} s, soon "
                    f"{held + LEAD * lasting:.1f}; at most {held_force(permit.force):.1f}"
                )
        for felt in self._new:
            force, torque = float(np.linalg.norm(felt.force)), float(np.linalg.norm(felt.torque))
            if gives is None:
                soon = force + max(grows, 0.0)
            else:
                more = deeper if foretold else 0.0
                soon = pressing_force(press_depth(force, *gives) + more, *gives)
            if soon > permit.force:
                says = f", soon {soon:.1f}" if force <= permit.force else ""
                return f"pressed with {force:.1f} N{says}; at most {permit.force:g}"
            if torque > permit.torque:
                return f"turned with {torque:.2f} N m; at most {permit.torque:g}"
        return ""


def _errs(bias: Floats) -> bool:
    """Whether a sensor that errs by (6,) cannot be believed."""
    force, torque = np.linalg.norm(bias[:3]), np.linalg.norm(bias[3:])
    return bool(force > BIAS[0] or torque > BIAS[1])
