"""Opening and shutting a charging lid by feel: a pure controller, told pose and force of a finger.

The finger is a rod beside the plug with a pin across its tip, which a linear actuator puts out. A
push latch is pressed and let go, and the lid comes out by itself; a catch is pulled over, the pin
hooked behind the lid's free edge from the recess beside it; of a latch that is not known pressing
is tried first, since nothing has to reach behind an edge for it. Then the pin leads the lid along
the arc of its hinge. To shut it the rod leads it back from outside and presses until it catches,
and touches it once more: what springs open again is not shut.

Frames: ``lid``, middle of its outer surface when it is shut, x right and y up for who looks, z
towards who looks, the hinge at the left; the finger's, z along the rod into the car, x to the left.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.charging.admittance import Admittance
from armsight.geometry.pose import log

LEFT, RIGHT = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
INWARD, OUTWARD = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
R_LID_FINGER = np.diag([-1.0, 1.0, -1.0])
"""The finger looks at the lid, the same up."""
GAIN = 2.5
"""Towards where it shall be [1/s]."""
BUMP = 15.0
"""Felt on the way through free air, it has met something that should not be there [N]."""
AJAR = 0.008
"""A lid whose latch has let go stands out so far at least [m]."""
AWAY = 0.26
"""Before the lid no part of it that swings is met so far out [m]."""
LAG = 0.015
"""A lid that is led is followed no farther ahead than this [m]."""
Plan = Generator[tuple[Vector3, Vector3], None, str]
"""Wanted velocity [m/s] and force [N] in the lid's frame, tick by tick; ends with what is wrong."""
Work = Literal["open", "shut", "leave"]
Arc = Callable[[float], Vector3]
"""Where the tip is when the lid is so far open [rad]."""


@dataclass(frozen=True)
class LidOptions:
    """How a lid is worked.

    Attributes:
        latch: ``push``; ``spring``, a catch to be pulled over; or ``unknown``: found by trying.
        half: half its edge [m]; thick: its thickness [m].
        radius: of rod and pin [m]; pin: how far it sticks out to the left [m].
        admittance: of mount and arm.
        speed: in free air and along the arc [m/s]; touch_speed: [m/s] and touch_force: [N].
        push, pull: greatest on the latch [N]; ramp: of them [N/s].
        open: how far it is opened [rad].
        patience: for one motion at most [s].
    """

    latch: Literal["push", "spring", "unknown"]
    half: float = 0.075
    thick: float = 0.008
    radius: float = 0.005
    pin: float = 0.015
    admittance: Admittance = field(default_factory=lambda: Admittance(speed=(0.08, 0.3)))
    speed: float = 0.07
    touch_speed: float = 0.012
    touch_force: float = 3.0
    push: float = 45.0
    pull: float = 50.0
    ramp: float = 40.0
    open: float = float(np.deg2rad(95.0))
    patience: float = 8.0


class LidHand:
    """Opens a lid, or shuts it. Feed it readings until it has ended.

    Args:
        options: of lid and finger.
        task: opens it, shuts it, or comes away from it.

    Attributes:
        ended: whether it has; problem: what is wrong then, in words; empty when nothing is.
        caught: why it did not come away from a lid that it had opened, or tried to; else empty.
        words: what is being done.
    """

    def __init__(self, options: LidOptions, task: Work = "open") -> None:
        self.options = options
        self.ended, self.problem, self.caught, self.words = False, "", "", ""
        self._plan = {"open": self._open, "shut": self._shut, "leave": self._leave}[task]()
        self._now = 0.0
        self._p, self._f = np.zeros(3), np.zeros(3)
        self._twist = np.zeros(6)
        self._last: float | None = None
        self._face = 0.0

    def step(
        self,
        now: float,
        T_lid_finger: Pose,
        wrench: Floats,
        held: bool = False,
        give: Vector3 | None = None,
    ) -> Floats:
        """One tick.

        Args:
            now: [s].
            T_lid_finger: of its tip by the joints and by what is believed of the lid.
            wrench: (6,) of the surroundings on the finger, tared, about its tip, in its axes.
            held: somebody else holds the arm still: no time passes.
            give: (3,) how far that has moved the tip, in its axes [m]; left out for a mount that
                turns about the tip.

        Returns:
            (6,) twist of the tip in its own axes [m/s], [rad/s].
        """
        o, R = self.options, T_lid_finger[:3, :3]
        dt = 0.0 if self._last is None else min(max(now - self._last, 0.0), 0.05)
        self._last = now
        if held or self.ended:
            self._twist = np.zeros(6)
            return np.zeros(6)
        self._now += dt
        self._f = R @ wrench[:3]
        moved = o.admittance.deflection(wrench)[:3] if give is None else give
        self._p = T_lid_finger[:3, 3] + R @ moved
        try:
            velocity, force = next(self._plan)
        except StopIteration as end:
            self.ended, self.problem = True, end.value or ""
            return np.zeros(6)
        twist = np.zeros(6)
        twist[:3] = R.T @ (velocity + (self._f + force) / o.admittance.damping[0])
        off = np.eye(4)
        off[:3, :3] = R.T @ R_LID_FINGER
        twist[3:] = 1.5 * log(off)[3:]
        self._twist = o.admittance.limited(twist, self._twist, dt)
        return self._twist.copy()

    # -- the two of them --------------------------------------------------------------------------

    def _open(self) -> Plan:
        problem = yield from self._find_shut()
        if not problem:
            problem = yield from self._unlatch()
        if not problem:
            problem = yield from self._lead(self._inside, self.options.open)
        if not problem:
            self.words = "feels whether it is open"
            felt = yield from self._against(LEFT, 0.04)
            problem = "" if felt else "the lid was lost on the way: look where it is"
        self.caught = yield from self._leave()
        return problem

    def _leave(self) -> Plan:
        """Away from the hinge, from under an edge that may be there, and out."""
        self.words = "comes away from the lid"
        out = self._p + np.array([0.03, 0.0, 0.0])
        yield from self._to(out)
        return (yield from self._to(np.array([out[0], 0.0, AWAY])))

    def _shut(self) -> Plan:
        o = self.options
        self.words = "goes round the lid"
        problem = yield from self._by((-0.02, AWAY), (-0.17, AWAY), (-0.17, 0.12))
        if problem:
            return problem
        felt = yield from self._against(RIGHT, 0.14)
        if not felt:
            return "no lid where it was left open: it is missing, or shut"
        problem = yield from self._lead(self._outside, float(np.deg2rad(4.0)))
        if not problem:
            self.words = "presses it shut"
            yield from self._press(INWARD, o.push, 0.03)
        yield from self._to(np.array([self._p[0], 0.0, 0.06]))
        if problem:
            return problem
        self.words = "feels whether it is shut"
        yield from self._to(np.array([0.055, 0.0, 0.03]))
        felt = yield from self._against(INWARD, 0.05)
        height = self._p[2] - o.radius
        yield from self._to(np.array([0.055, 0.0, 0.10]))
        if not felt:
            return "the lid is not felt where it should be shut"
        return "" if height < 0.008 else "the lid springs open again: its latch does not hold"

    def _find_shut(self) -> Plan:
        """Whether there is a shut lid, and where its face is."""
        self.words = "feels for the lid"
        problem = yield from self._to(np.array([0.055, 0.0, 0.04]))
        if problem:
            return "something stands before the lid: is it open?"
        felt = yield from self._against(INWARD, 0.06)
        if not felt or self._p[2] < -0.015:
            return "no lid: nothing is felt where it should be"
        self._face = self._p[2] - self.options.radius
        return ""

    def _unlatch(self) -> Plan:
        o = self.options
        if o.latch != "spring":
            if (yield from self._push()):
                return (yield from self._hook())
            if o.latch == "push":
                return f"the lid stays shut: pressed with {o.push:.0f} N, its latch does not let go"
        problem = yield from self._pull()
        if problem and o.latch == "unknown":
            return f"the lid stays shut, pressed with {o.push:.0f} N as well: {problem}"
        return problem

    def _push(self) -> Generator[tuple[Vector3, Vector3], None, bool]:
        """Press the lid in and let it out; whether its latch has let go."""
        o = self.options
        self.words = "presses the latch"
        yield from self._press(INWARD, o.push, 0.02)
        yield from self._to(self._p + 0.06 * OUTWARD)
        yield from self._against(INWARD, 0.07)
        return bool(self._p[2] - o.radius >= self._face + AJAR)

    def _hook(self) -> Plan:
        """The pin behind the free edge of a lid that stands ajar."""
        under = self._face + 0.010
        way = (0.055, 0.06), (0.108, 0.06), (0.108, under), (0.083, under)
        return (yield from self._by(*way))

    def _pull(self) -> Plan:
        """The pin behind the free edge, over the catch."""
        o = self.options
        self.words = "hooks the lid"
        yield from self._to(np.array([0.108, 0.0, self._face + 0.04]))
        under = self._face - o.thick - o.radius - 0.005
        problem = yield from self._by((0.108, under), (0.083, under))
        if problem:
            return problem
        felt = yield from self._against(OUTWARD, 0.025)
        if not felt:
            return "the pin finds no edge to pull at"
        self.words = "pulls it over its catch"
        start = self._p[2]
        yield from self._press(OUTWARD, o.pull, 0.02)
        if self._p[2] < start + 0.008:
            return f"the lid is stuck: pulled with {o.pull:.0f} N"
        return ""

    # -- motions ----------------------------------------------------------------------------------

    def _to(self, goal: Vector3) -> Plan:
        """Through free air."""
        o, end = self.options, self._now + self.options.patience
        while (away := float(np.linalg.norm(goal - self._p))) > 0.002:
            if float((goal - self._p) @ self._f) < -BUMP * away:
                return "something is in the way"
            if self._now > end:
                return "the arm does not get there"
            yield _shortened(GAIN * (goal - self._p), o.speed), np.zeros(3)
        return ""

    def _by(self, *way: tuple[float, float]) -> Plan:
        """Through free air by points (x, z) in the middle of the lid's height [m]."""
        for x, z in way:
            problem = yield from self._to(np.array([x, 0.0, z]))
            if problem:
                return problem
        return ""

    def _against(
        self, direction: Vector3, farthest: float
    ) -> Generator[tuple[Vector3, Vector3], None, bool]:
        """Slowly until something is felt; whether it was within ``farthest`` [m]."""
        o, start = self.options, self._p.copy()
        end = self._now + farthest / o.touch_speed + 4.0
        while float(direction @ self._f) > -o.touch_force:
            if float(direction @ (self._p - start)) > farthest or self._now > end:
                return False
            yield o.touch_speed * direction, np.zeros(3)
        return True

    def _press(self, direction: Vector3, most: float, farthest: float) -> Plan:
        """With a force that rises, until it is all felt or something gives."""
        o, start, force, firm = self.options, self._p.copy(), 8.0, 0.0
        end = self._now + o.patience
        last = self._now
        while self._now < end and firm < 0.25:
            felt = -float(direction @ self._f)
            if float(direction @ (self._p - start)) > farthest:
                break
            force = min(force + o.ramp * (self._now - last), most, max(felt, 0.0) + 20.0)
            firm = firm + self._now - last if felt > 0.9 * most else 0.0
            last = self._now
            yield np.zeros(3), force * direction
        return ""

    def _lead(self, arc: Arc, end: float) -> Plan:
        """The lid along its arc to an angle [rad], softly."""
        o, last, stalled = self.options, self._now, 0.0
        angle = min(np.linspace(0.0, 2.0, 201), key=lambda a: np.linalg.norm(arc(a) - self._p))
        way = float(np.sign(end - angle))
        rate = way * o.speed / (2.0 * o.half)
        while way * (end - angle) > 0.0:
            self.words = f"leads the lid, {np.rad2deg(angle):.0f} deg open"
            dt, last = self._now - last, self._now
            goal = arc(angle)
            ahead = np.zeros(3)
            if float(np.linalg.norm(goal - self._p)) < LAG:
                stalled, angle = 0.0, angle + rate * dt
                ahead = rate * (arc(angle + 0.01) - arc(angle)) / 0.01
            else:
                stalled += dt
            if stalled > 1.5:
                return f"the lid is stuck at {np.rad2deg(angle):.0f} deg"
            yield _shortened(ahead + GAIN * (goal - self._p), 1.5 * o.speed), np.zeros(3)
        return ""

    # -- geometry ---------------------------------------------------------------------------------

    @property
    def _hinge(self) -> Vector3:
        o = self.options
        return np.array([-o.half, 0.0, self._face - 0.5 * o.thick])

    def _inside(self, angle: float) -> Vector3:
        """Where the rod's tip is while its pin lies at the lid's inside near the free edge."""
        o = self.options
        along, into = _axes(angle)
        rho, off = 1.8 * o.half, 0.5 * o.thick + o.radius
        return np.asarray(self._hinge + rho * along + off * into + o.pin * RIGHT)

    def _outside(self, angle: float) -> Vector3:
        """The same while the rod lies at its outside."""
        o = self.options
        along, into = _axes(angle)
        return np.asarray(self._hinge + 1.65 * o.half * along - (0.5 * o.thick + o.radius) * into)


def _axes(angle: float) -> tuple[Vector3, Vector3]:
    """Of a lid that is so far open: from hinge to free edge, and towards its inside."""
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return np.array([c, 0.0, s]), np.array([s, 0.0, -c])


def _shortened(vector: Vector3, most: float) -> Vector3:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)
