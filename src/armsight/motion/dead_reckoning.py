"""Where the joints are by their commands alone, and readings that creep away from there.

Readings that drift by a degree or two in a second, and say that they move so, look for a quarter of
a second like drives that answer a little sooner or later. They do not for long: a drive's delay is
always the same, so it can be learnt, and what it holds back comes in the end.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import JointVector, Mask
from armsight.devices.data import JointState
from armsight.motion.arm_model import ArmState, DelayedArm

PERIOD = 0.03
"""It is looked this often [s]: what creeps is slow."""
SLACK = 0.009
"""Readings may be elsewhere by so much [rad] ..."""
TIMING, RAMP, LATELY = 0.01, 0.1, 0.3
"""... by what so much time makes of the joint's speed [s], and by this share of the way on which it
would be braked: delays and ramps are not known better. The fastest of so long ago counts [s]."""
SHARE, BRAKED = 0.006, 0.3
"""Ways may be wrong by the first share for ever, those of a stop by the second."""
MOVES = 0.05
"""Joints are in motion above it [rad/s]."""
MEMORY = 10.0
"""Changes of speed tell how late the drives are; those of so long ago count a third [s]."""
UNKNOWN = 0.005
"""Before the squares of these changes come to more, the delay is not known [rad^2/s^2]."""
USUAL, LEAST = 4.0, 0.006
"""Of the room that all this makes, so many times what the arm has needed of it lately is left to
it, never less than this [rad]: drives of the packaged arms give way by 0.0023 rad to 70 N."""
MOVED, ROUND, USED = 1.0, 1.0, 30.0
"""What it needs is known after so long in motion [s], but for the last of rounds of so long [s]:
what creeps must not make room for itself. What was needed so long ago counts a third [s]."""


class DeadReckoning:
    """Plays commands forward from one reading and compares all later ones with that.

    Args:
        arm: a model of the drives, for this watch alone. They may be sooner, or later, by as much
            as its delay.
        names: (n) of the joints.
    """

    def __init__(self, arm: DelayedArm, names: tuple[str, ...]) -> None:
        self._arm = arm
        self._names = names
        self._delay = _Delay(arm.delay)
        self._usual = _Usual()
        self._led: ArmState | None = None
        self._under_way = False

    def sent(self, now: float, velocity: JointVector, brake: bool) -> None:
        """A command (or a stop) was sent at ``now`` [s]."""
        self._arm.sent(now, velocity, brake)

    def forget(self) -> None:
        """Time was lost: neither commands nor readings before it say where the arm is.

        They do say how late its drives are, and what it needs of its room.
        """
        self._arm.forget()
        self._begin()

    def fault(self, joints: JointState) -> str:
        """Which joint is elsewhere, and by how much, or nothing; then it begins anew.

        Args:
            joints: a reading that is well-formed, later than those before.
        """
        led = self._led
        if led is None or not self._under_way:
            # What was commanded before the first command that is known is under way until it acts.
            self._under_way = joints.stamp >= self._arm.acts + self._arm.delay
            self._start(joints)
        elif joints.stamp >= led.time + PERIOD:
            left, over = self._compare(led, joints)
            j = int(np.argmax(over))
            if over[j] > 0.0:
                self._begin()
                self._delay.forget()
                self._usual.forget()
                return (
                    f"{self._names[j]} does not follow: it says that it is "
                    f"{np.rad2deg(left[j]):.1f} deg beside where its commands led it; "
                    "check its encoder, its drive, and how hard it brakes"
                )
        return ""

    def _begin(self) -> None:
        """The next reading is believed."""
        self._led, self._under_way = None, False

    def _start(self, joints: JointState) -> None:
        """Believe a reading."""
        position, self._speed = np.array(joints.position), np.array(joints.velocity)
        self._began = joints.stamp
        self._led = ArmState(joints.stamp, position, self._speed)
        self._off = self._anchor = np.zeros_like(position)
        self._fast = np.abs(self._speed)
        self._stopped, self._braked = np.full(len(position), -np.inf), np.zeros(len(position))

    def _compare(self, before: ArmState, joints: JointState) -> tuple[JointVector, JointVector]:
        """(n,) how far the joints are from where they were led, and by how much too far [rad]."""
        led = self._ahead(before, joints.stamp)
        off = np.asarray(joints.position) - led.position
        speed = 0.5 * (led.velocity + joints.velocity)  # halfway between the model and the drives
        elapsed = led.time - before.time
        drift, calm = self._drift(before, led)
        gained, faster = np.where(calm, [off - self._off, speed - self._speed], 0.0)
        sooner, unknown = self._delay.learn(elapsed, gained, faster)
        self._led, self._off, self._speed = led, off, speed
        self._fast = np.maximum(np.abs(led.velocity), math.exp(-elapsed / LATELY) * self._fast)
        left = joints.position - self._ahead(led, led.time + sooner).position - self._anchor
        # Where it began depends on the delay, be it known or not yet.
        free = (unknown * self._fast > 0.5 * SLACK) | (led.time < self._began + self._arm.delay)
        most = np.where(free, np.inf, drift)
        astray = np.clip(left, -most, most)
        self._anchor = self._anchor + astray
        self._braked = np.maximum(self._braked - np.abs(astray), 0.0)
        timing = TIMING + unknown + 0.5 * RAMP * self._fast / self._arm.brake
        room = SLACK + timing * self._fast
        if not free.any() and calm.all() and self._fast.max() > MOVES:
            self._usual.learn(elapsed, float((np.abs(left) / room).max()))
        usual = np.maximum(self._usual.share * room, LEAST)
        room = np.where(calm, np.minimum(usual, room), room)
        return left, np.where(free, 0.0, np.abs(left) - room)

    def _drift(self, before: ArmState, led: ArmState) -> tuple[JointVector, Mask]:
        """By how much readings may go astray for ever between two states, and who is calm.

        (n,) [rad], (n,): calm is a joint that has not been stopped lately. Drives that brake
        otherwise than declared still do when the model of them stands.
        """
        slowing = np.abs(led.velocity - before.velocity) / (led.time - before.time)
        way = np.abs(led.position - before.position)
        stops = slowing > 1.02 * self._arm.acceleration  # no command does that
        self._stopped = np.where(stops, led.time, self._stopped)
        calm = led.time > self._stopped + LATELY
        share = np.where(stops, BRAKED * slowing / self._arm.brake, 0.0)
        self._braked = np.where(calm, 0.0, self._braked + share * way)
        return SHARE * way + self._braked, calm

    def _ahead(self, state: ArmState, until: float) -> ArmState:
        """What commands make of a state until then [s]; before it, what its speed does."""
        if until < state.time:
            back = (until - state.time) * state.velocity
            return ArmState(until, state.position + back, state.velocity)
        return self._arm.ahead(JointState(state.time, state.position, state.velocity), until)


class _Delay:
    """By how much drives are sooner than declared, learnt from how they change their speed.

    Drives that are sooner by a time are ahead by that time's way, and by more when the speed grows:
    least squares over the changes of both, the last ones foremost.
    """

    def __init__(self, most: float) -> None:
        self._most = most
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self._squares, self._products = 0.0, 0.0

    def learn(self, elapsed: float, off: JointVector, faster: JointVector) -> tuple[float, float]:
        """By how much they are sooner, and how far that is unknown [s].

        Args:
            elapsed: in this time [s] ...
            off: (n,) ... the drives came ahead by so much [rad], ...
            faster: (n,) ... and became faster by this [rad/s].
        """
        kept = math.exp(-elapsed / MEMORY)
        self._squares = kept * self._squares + float(faster @ faster)
        self._products = kept * self._products + float(faster @ off)
        known = self._squares + UNKNOWN
        sooner = max(-self._most, min(self._products / known, self._most))
        return sooner, self._most * UNKNOWN / known


class _Usual:
    """Which share of its room an arm is left.

    Learnt from the arm: drives that are as they are declared need next to nothing of it.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known: all of the room is left."""
        self.share = 1.0
        self._time = self._before = self._last = self._now = 0.0
        self._ends = ROUND

    def learn(self, elapsed: float, used: float) -> None:
        """In this time in motion [s] so much of the room was used."""
        self._time += elapsed
        self._now = max(self._now, used)
        if self._time >= self._ends:
            self._ends += ROUND
            self._before = max(math.exp(-ROUND / USED) * self._before, self._last)
            self._last, self._now = self._now, 0.0
            if self._time >= MOVED + ROUND:
                self.share = min(USUAL * self._before, 1.0)
