"""Plugging in by force: a pure controller, told pose and wrench, that answers with a twist.

Guarded touch, yielding in all six axes (the ring of the sleeve lies flat on the inlet's face and
so finds its tilt), an Archimedean spiral until the plug drops in, a force ramp, back and again
when it jams, and an honest test of the end: depth **and** force **and** small moment **and** tilt.
Out again along the same axis. Frames: the plug's, z out of its mouth, so into the car; ``seat`` is
the plug's frame where it would be fully plugged in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.admittance import Admittance
from armsight.charging.spiral import Spiral, SpiralOptions
from armsight.geometry.pose import log

TO_AXIS = 1.5
"""Gain with which the plug keeps to the believed axis until it touches [1/s]."""
FACE_OFF = 0.003
"""The face is where it is believed to be, but for this [m]."""
BEYOND = 0.004
"""A plug that seems so much deeper than its seat is pressed harder than the sensor says [m]."""
AHEAD = 20.0
"""The wanted force runs ahead of the felt one by this at most [N]."""


class Phase(StrEnum):
    """What is being done."""

    APPROACH = "approach"
    TOUCH = "touch"
    SETTLE = "settle"
    SEARCH = "search"
    INSERT = "insert"
    BACK = "back"
    SEATED = "seated"
    PULL = "pull"
    OUT = "out"
    FAILED = "failed"


@dataclass(frozen=True)
class InsertOptions:
    """Forces and tolerances, as measured on the simulated bench (docs/charging.md).

    Attributes:
        depth: of the seat below the face [m].
        admittance: of mount and arm.
        touch_speed: [m/s]; touch_force: [N] that ends the touch.
        search_force: pressed with while searching [N]; spiral: of the search.
        hooked: bent by more than this, only one side of the plug is in [rad].
        search_turn, insert_turn: stiffness towards the attitude in which the sleeve lay flat on
            the inlet's face, while searching and inserting [N m/rad].
        captured: the plug is in when it is this deep [m].
        ramp: of the force [N/s]; push, pull: greatest [N].
        shallow: above this a tilted plug can wedge (twice friction times radius) [m];
            shallow_push: greatest there, since what is pressed into a wedge leaps when it comes
            loose [N].
        axial_speed: of insertion [m/s].
        stuck: without progress for so long it is jammed [s].
        tries: before giving up.
        depth_tolerance: of the seat [m]; seat_force: [N]; seat_moment: [N m]; seat_tilt: [rad],
            on top of what the port's believed place and attitude may be off by, ``port_depth`` [m]
            and ``port_tilt`` [rad].
        hold: all of that for so long [s].
        seconds: for one attempt at most [s].
    """

    depth: float = 0.036
    admittance: Admittance = field(default_factory=Admittance)
    touch_speed: float = 0.012
    touch_force: float = 5.0
    search_force: float = 10.0
    spiral: SpiralOptions = field(default_factory=SpiralOptions)
    hooked: float = float(np.deg2rad(6.0))
    search_turn: float = 25.0
    insert_turn: float = 5.0
    captured: float = 0.005
    ramp: float = 40.0
    push: float = 85.0
    pull: float = 105.0
    shallow: float = 0.02
    shallow_push: float = 30.0
    axial_speed: float = 0.02
    stuck: float = 0.5
    tries: int = 4
    depth_tolerance: float = 0.0015
    seat_force: float = 45.0
    seat_moment: float = 2.0
    seat_tilt: float = float(np.deg2rad(2.0))
    port_depth: float = 0.0
    port_tilt: float = float(np.deg2rad(6.0))
    hold: float = 0.3
    seconds: float = 40.0


@dataclass(frozen=True)
class Felt:
    """What the controller is told.

    Attributes:
        now: [s].
        T_seat_plug: where the plug would be if its mount did not give way, by the joints and by
            what is believed of the port.
        wrench: (6,) of the surroundings on the plug, tared, about its origin, in its axes.
        held: somebody else holds the arm still: nothing is a jam, no time passes.
    """

    now: float
    T_seat_plug: Pose
    wrench: Floats
    held: bool = False


@dataclass(frozen=True)
class Answer:
    """What it says.

    Attributes:
        twist: (6,) of the plug's origin in its own axes [m/s], [rad/s].
        phase: what is being done; words: for people.
        depth: of the plug's front below the inlet's face, the mount's give taken off [m].
    """

    twist: Floats
    phase: Phase
    words: str
    depth: float


class Insertion:
    """Plugs in, or (``out=True``) takes out. Feed it readings until the phase is an end.

    Ends are ``SEATED``, ``OUT`` and ``FAILED``; the words then say what happened.
    """

    def __init__(self, options: InsertOptions | None = None, out: bool = False) -> None:
        self.options = options or InsertOptions()
        self.phase = Phase.PULL if out else Phase.APPROACH
        self.words = ""
        self.tries = 0
        self._begun: float | None = None
        self._last = 0.0
        self._since = 0.0
        self._twist = np.zeros(6)
        self._face = 0.0  # depth at which the sleeve lay flat
        self._axis = np.zeros(2)  # where the socket is believed to be across
        self._spiral: Spiral | None = None
        self._force = 0.0
        self._deepest = -np.inf
        self._progress = 0.0
        self._good = 0.0
        self._retreat = 0.0  # depth to go back to
        self._flat: Floats | None = None  # attitude in which the sleeve lay flat on the face

    def step(self, felt: Felt) -> Answer:
        """One tick."""
        o = self.options
        if self._begun is None:
            self._begun = self._last = self._since = self._progress = felt.now
        passed = max(felt.now - self._last, 0.0)
        dt = min(passed, 0.05)
        self._last = felt.now
        give = o.admittance.deflection(felt.wrench)
        depth = o.depth + float(felt.T_seat_plug[2, 3]) + float(give[2])
        if felt.held:
            self._begun, self._since = self._begun + passed, self._since + passed
            self._progress += passed
        elif self.phase not in (Phase.SEATED, Phase.OUT, Phase.FAILED):
            if felt.now - self._begun > o.seconds:
                self._go(Phase.FAILED, felt.now, f"gave up after {o.seconds:.0f} s")
            else:
                getattr(self, f"_{self.phase.value}")(felt, depth, dt)
        twist = self._wish(felt, depth)
        self._twist = o.admittance.limited(twist, self._twist, dt)
        return Answer(self._twist.copy(), self.phase, self.words, depth)

    def _go(self, phase: Phase, now: float, words: str = "") -> None:
        self.phase, self._since, self.words = phase, now, words
        self._deepest, self._progress, self._good = -np.inf, now, 0.0

    # What ends each phase.

    def _approach(self, felt: Felt, depth: float, dt: float) -> None:
        if felt.now - self._since > 0.1:
            self._go(Phase.TOUCH, felt.now)

    def _touch(self, felt: Felt, depth: float, dt: float) -> None:
        o = self.options
        if depth > o.captured + 0.003:
            self._begin_insert(felt, "dropped in")
        elif felt.wrench[2] < -o.touch_force:
            self._go(Phase.SETTLE, felt.now, "touched")

    def _settle(self, felt: Felt, depth: float, dt: float) -> None:
        """Pressed lightly, the sleeve's ring turns until it lies flat."""
        if self._is_in(felt, depth):
            self._begin_insert(felt, "dropped in")
            return
        o = self.options
        moment = float(np.linalg.norm(felt.wrench[3:5]))
        waited = felt.now - self._since
        if waited > 1.5 or (waited > 0.4 and moment < 0.12):
            if self._tilt(felt) > 2.0 * o.hooked:
                self._again(felt, -0.002, "no flat face found", "lay askew")
                return
            self._spiral = Spiral(o.spiral, felt.T_seat_plug[:2, 3])
            self._flat = felt.T_seat_plug[:3, :3].copy()
            self._face = float(np.clip(depth, -FACE_OFF, FACE_OFF))
            self._go(Phase.SEARCH, felt.now, "searching")

    def _search(self, felt: Felt, depth: float, dt: float) -> None:
        assert self._spiral is not None
        if self._is_in(felt, depth):
            self._begin_insert(felt, "found")
        elif self._spiral.ended:
            self._again(felt, -0.002, "no socket found by the spiral", "the spiral ended")
        else:
            self._spiral.advance(depth - self._face, dt)

    def _insert(self, felt: Felt, depth: float, dt: float) -> None:
        o = self.options
        most = o.shallow_push if depth < o.shallow else o.push
        self._ramp(-float(felt.wrench[2]), most, dt)
        beyond = depth - o.depth - o.port_depth
        if beyond > BEYOND:  # its mount gives more than what is felt would have it
            too = f"{1e3 * (depth - o.depth):.1f} mm deeper than its seat"
            self._go(Phase.FAILED, felt.now, f"{too}: force sensor or port are not as believed")
            return
        if depth > self._deepest + 0.0003:
            self._deepest, self._progress = depth, felt.now
        there = depth > o.depth - o.depth_tolerance - o.port_depth
        moment = float(np.linalg.norm(felt.wrench[3:5]))
        firm = felt.wrench[2] < -o.seat_force
        tilt = self._tilt(felt)
        still = felt.now - self._progress > 0.2
        if there and firm and still and moment < o.seat_moment and tilt < o.seat_tilt + o.port_tilt:
            self._good += dt
            if self._good >= o.hold:
                self._go(Phase.SEATED, felt.now, f"seated at {1e3 * depth:.1f} mm")
            return
        self._good = 0.0
        waiting = o.stuck if self._force >= o.push else 2.5
        hooked = depth < 0.012 and self._bent(felt) > 2.0 * o.hooked
        stuck = felt.now - self._progress > waiting and felt.now - self._since > 0.5
        if hooked or stuck:
            at = f"at {1e3 * depth:.1f} of {1e3 * o.depth:.1f} mm"
            why = "there, but bent" if there else "jammed"
            back = depth - 0.003 if depth > 0.015 else -0.002
            if not hooked:
                self._axis = felt.T_seat_plug[:2, 3].copy()
            self._again(felt, back, f"{why} {at}", f"stuck {at}")

    def _again(self, felt: Felt, back: float, given_up: str, why: str) -> None:
        """Back to a depth [m] and once more, or given up."""
        self.tries += 1
        if self.tries >= self.options.tries:
            self._go(Phase.FAILED, felt.now, given_up)
        else:
            self._retreat = back
            self._go(Phase.BACK, felt.now, f"{why}: back and again")

    def _back(self, felt: Felt, depth: float, dt: float) -> None:
        """Back until it has come loose, or out where it hardly was in: it re-centres."""
        waited = felt.now - self._since
        if (waited > 0.4 and depth < self._retreat) or waited > 4.0:
            if self._is_in(felt, depth):
                self._begin_insert(felt, "again")
            else:
                self._flat = None
                self._face = 0.0
                self._go(Phase.TOUCH, felt.now, "again")

    def _pull(self, felt: Felt, depth: float, dt: float) -> None:
        o = self.options
        self._ramp(float(felt.wrench[2]), o.pull, dt)
        if depth < -0.01:
            self._go(Phase.OUT, felt.now, "unplugged")
        elif felt.now - self._since > 0.75 * o.seconds:
            self._go(Phase.FAILED, felt.now, f"stuck at {1e3 * depth:.1f} mm on the way out")

    def _ramp(self, felt: float, most: float, dt: float) -> None:
        """What is wanted rises, but not far above what is felt.

        An arm that the guard slows lags behind; it would leap when it is let go.
        """
        self._force = min(self._force + self.options.ramp * dt, most, max(felt, 0.0) + AHEAD)

    def _is_in(self, felt: Felt, depth: float) -> bool:
        """Deep enough, and not hooked with one side only."""
        deep = depth > self._face + self.options.captured
        return deep and self._bent(felt) < self.options.hooked

    def _bent(self, felt: Felt) -> float:
        """Angle from the attitude in which the sleeve lay flat, the mount's give taken in [rad]."""
        off = np.eye(4)
        off[:3, :3] = self._level().T @ felt.T_seat_plug[:3, :3]
        give = self.options.admittance.deflection(felt.wrench)[3:5]
        return float(np.linalg.norm(log(off)[3:5] + give))

    def _begin_insert(self, felt: Felt, words: str) -> None:
        self._force = self.options.search_force
        self._go(Phase.INSERT, felt.now, words)

    def _tilt(self, felt: Felt) -> float:
        """Between the plug and the believed socket, the mount's give taken in [rad]."""
        give = self.options.admittance.deflection(felt.wrench)[3:5]
        return float(np.linalg.norm(log(felt.T_seat_plug)[3:5] + give))

    # What is wished in each phase.

    def _wish(self, felt: Felt, depth: float) -> Floats:
        o = self.options
        push = np.zeros(6)
        across = felt.T_seat_plug[:2, :2]
        if self.phase in (Phase.APPROACH, Phase.FAILED, Phase.OUT):
            return np.zeros(6)
        if self.phase is Phase.TOUCH:
            twist = o.admittance.answer(felt.wrench, push)
            twist[2] = o.touch_speed
            touched = min(1.0, abs(felt.wrench[2]) / o.touch_force)
            twist[3:] = touched * twist[3:] + (1.0 - touched) * self._to_level(felt)
            twist[:2] += self._to_axis(felt)
            return twist
        if self.phase is Phase.BACK:
            push[2] = -40.0
            push[3:] = self._upright(felt, o.insert_turn)
            twist = o.admittance.answer(felt.wrench, push)
            twist[2] = float(np.clip(twist[2], -0.025, 0.01))
            return twist
        if self.phase is Phase.SETTLE:
            push[2] = o.search_force
        elif self.phase is Phase.SEARCH:
            assert self._spiral is not None
            push[2] = o.search_force
            push[:2] = across.T @ self._spiral.pull(felt.T_seat_plug[:2, 3])
            push[3:] = self._upright(felt, o.search_turn)
        elif self.phase is Phase.INSERT:
            push[2] = self._force
            push[3:] = self._upright(felt, o.insert_turn * max(0.0, 1.0 - depth / o.shallow))
        elif self.phase is Phase.SEATED:
            push[2] = 0.3 * o.push
        else:  # out
            push[2] = -self._force
        twist = o.admittance.answer(felt.wrench, push)
        if self.phase is Phase.SEARCH and self._spiral is not None:
            twist[:2] += across.T @ self._spiral.velocity()
        fast = 2.0 * o.axial_speed if self.phase is Phase.PULL else o.axial_speed
        twist[2] = float(np.clip(twist[2], -fast, o.axial_speed))
        if self.phase in (Phase.INSERT, Phase.PULL):
            twist[3:5] += self._wiggle(felt.now, depth)
        return twist

    def _wiggle(self, now: float, depth: float) -> Floats:
        """(2,) turning that loosens what is stuck: the axis goes round a cone."""
        idle = now - self._progress
        shallow = self.phase is Phase.INSERT and depth < self.options.shallow
        wait, degrees, rate = (0.15, 2.0, 1.0) if shallow else (0.35, 0.25, 2.0)
        if idle < wait:
            return np.zeros(2)
        turn = 2 * np.pi * rate * (now - self._since)
        size = np.deg2rad(degrees) * 2 * np.pi * rate
        return np.asarray(size * np.array([np.cos(turn), np.sin(turn)]))

    def _level(self) -> Floats:
        """(3, 3) attitude in which the sleeve lay flat; before it did, the believed one."""
        return np.eye(3) if self._flat is None else self._flat

    def _to_level(self, felt: Felt) -> Floats:
        """(3,) turning rate back to that attitude in free air, in the plug's axes."""
        off = np.eye(4)
        off[:3, :3] = felt.T_seat_plug[:3, :3].T @ self._level()
        return np.asarray(TO_AXIS * log(off)[3:])

    def _upright(self, felt: Felt, stiffness: float) -> Floats:
        """(3,) moment towards that attitude, in the plug's axes."""
        moment = stiffness / TO_AXIS * self._to_level(felt)
        return np.asarray(moment * min(1.0, 3.0 / max(float(np.linalg.norm(moment)), 1e-9)))

    def _to_axis(self, felt: Felt) -> Floats:
        """(2,) velocity back to the believed axis: who commands may have let it slide aside."""
        away = TO_AXIS * (self._axis - felt.T_seat_plug[:2, 3])
        size = float(np.linalg.norm(away))
        away = away * min(1.0, self.options.touch_speed / max(size, 1e-9))
        return np.asarray(felt.T_seat_plug[:2, :2].T @ away)
