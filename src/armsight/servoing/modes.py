"""The ways to chase a target: V's, with or without the pair, and ours; one interface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from armsight.arrays import JointVector, Pose, Vector3
from armsight.devices.data import JointState
from armsight.motion.data import GuardStatus
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import SprungTip
from armsight.servoing.aim import Aim, Weights
from armsight.servoing.approach import Funnel, along_the_tool, facing, side, touch_aim
from armsight.servoing.clocks import ClockWatch
from armsight.servoing.docking import Direction, Touchable
from armsight.servoing.estimate import FilterConfig, TargetEstimate, TargetFilter
from armsight.servoing.law import LawConfig, VelocityLaw
from armsight.servoing.master import PaperMaster, Source
from armsight.servoing.segments import SegmentConfig, SegmentPlanner
from armsight.servoing.sighting import Look
from armsight.servoing.straying import GOES, Straying
from armsight.servoing.takeover import Takeover

LOST = 0.8
"""A target that nobody has seen for so long is not chased [s]."""
LASTS = 0.9
"""What a sighting's velocity is good for [s]."""
SEEN_WITHIN = 0.18
"""A target that was seen within this time may be touched [s]; later the tip goes back ..."""
RETREAT, RETREAT_SPEED = 0.1, 1.0
"""... by this much at most [m], so fast [m/s]."""
NEAR_BODY = 0.5
"""So near to somebody's face or hand the guard lets the arm move gently only [m]: separation leaves
it no speed within 0.47 m. A wish that is faster would be taken for one whose way is blocked."""
WIDEST = math.radians(50.0)
"""The tool is turned no farther than this from the operator's side for a target's normal [rad]."""
CLOSE, STEEP = (0.68, 0.46), math.radians(60.0)
"""Before what comes this near to the base's axis [m] the tool points down by up to this much [rad]:
the wrist would come over that axis, where the arm turns fast for nothing."""
BRAKES, LEAST_BRAKES, LATE, MEETS = 2.2, 0.6, 0.13, 0.03
"""To what may turn the tip comes as if it slowed by this much [m/s^2], less what that may turn by
but never less than so much [m/s^2], so late [s]; and it may always come with so much [m/s]."""
PAPER_SIGMA, PAPER_MARGIN, PAPER_DRIFT = 0.008, 0.02, 0.05
"""What V's estimate of a target is worth, for a permit [m], [m], [m/s]: it has no covariance."""
SOURCES = {Source.NONE: 0.0, Source.ALL: 1.0, Source.TWO: 2.0, Source.PAIR: 3.0}


@dataclass(frozen=True)
class ChaseConfig:
    """What every mode needs to know.

    Attributes:
        vertical: (3,) unit, up in ``base``; front: (3,) unit, towards the person's side.
        radius: of the target's surface about its point [m]; 0 for a plane.
        direction: how the tool points; turned: see :class:`~armsight.servoing.docking.Docking`.
        pitch: how far below the horizontal our tool points [rad]: the wrist keeps off the table,
            and off the pose in which its axes lie in one plane; V's points horizontally.
        funnel: of the touch.
        gentle: speed of the tip [m/s] where it is nearer than ``NEAR_BODY`` to somebody's part.
        reserve: so wrong a prediction may be [m] without harm: from what strays more a tip that has
            touched it leaves at once.
        tip: how the tool's own tip gives way; None where it does not.
        law, filter, segments, weights: of the parts.
    """

    vertical: Vector3
    front: Vector3
    radius: float
    direction: Direction = "facing"
    turned: float = 1.0
    pitch: float = math.radians(30.0)
    funnel: Funnel = field(default_factory=Funnel)
    gentle: float = math.inf
    reserve: float = math.inf
    tip: SprungTip | None = None
    law: LawConfig = field(default_factory=LawConfig)
    filter: FilterConfig = field(default_factory=FilterConfig)
    segments: SegmentConfig = field(default_factory=SegmentConfig)
    weights: Weights = field(default_factory=Weights)


@dataclass(frozen=True)
class Wish:
    """(n,) joint velocities [rad/s], by evidence of ``exposure`` [s], good for ``lasts`` [s]."""

    velocity: JointVector
    exposure: float
    lasts: float = LASTS


class Chase(Protocol):
    """Turns what the cameras see into what the joints should do.

    Attributes:
        robot: whose joints.
        state, reason: in words, for the page.
        place: (3,) where the target is believed to be now [m], or None.
        distance: of the tip from the target's surface, as believed [m]; inf without a target.
        source_number: which sensor leads, for a curve.
        config: may be exchanged between steps, for another stand-off.
        give: how far the tip gives way to what presses [m], below 0 goes on behind the surface;
            V's modes, which feel nothing, do neither.
    """

    robot: Robot
    state: str
    reason: str
    place: Vector3 | None
    distance: float
    source_number: float
    config: ChaseConfig
    give: float

    @property
    def estimate(self) -> TargetEstimate | None:
        """Of the filter, in the mode that has one."""
        ...

    @property
    def switches(self) -> int:
        """Changes of the sensor that leads."""
        ...

    @property
    def warning(self) -> str:
        """What is wrong with the cameras, in words; empty where nothing is known to be."""
        ...

    @property
    def iterations(self) -> int:
        """Segments begun."""
        ...

    def touchable(self) -> Touchable | None:
        """The target as whoever wants to touch it has to describe it; None if it is not known."""
        ...

    def before(self, gap: float) -> Pose | None:
        """``T_base_tcp`` so far before the target [m] that a planned way may lead to; or None."""
        ...

    def reset(self) -> None:
        """Begin anew."""
        ...

    def see(self, look: Look) -> None:
        """One camera looked."""
        ...

    def led(self) -> None:
        """The arm is led by something else in this round, not by what was wished."""
        ...

    def step(self, now: float, joints: JointState, guard: GuardStatus | None) -> Wish | None:
        """What the joints should do now; None to rest."""
        ...


def meeting_speed(left: float, turns: float) -> float:
    """Speed [m/s] at which the tip may come to what may turn: from it the arm can still stop.

    Args:
        left: of the way [m].
        turns: acceleration [m/s^2] that the target's prediction does not know of.
    """
    slows = max(BRAKES - turns, LEAST_BRAKES)
    lasts = LATE * slows
    return max(math.sqrt(lasts * lasts + 2.0 * slows * max(left, 0.0)) - lasts, MEETS)


class OurChase:
    """One estimate of all sensors, predicted to the moment of action; velocities at 125 Hz."""

    def __init__(
        self, robot: Robot, cameras: Sequence[str], wrist: str, config: ChaseConfig
    ) -> None:
        self.robot, self.config = robot, config
        self.filter = TargetFilter(cameras, wrist, config.filter)
        self.law = VelocityLaw(robot, config.law, config.weights)
        self.clocks = ClockWatch(cameras)
        self.reset()

    def reset(self) -> None:
        """Begin anew; what was learned of the cameras is forgotten, too."""
        self.filter.reset()
        self.clocks.reset()
        self.law.reset()
        self.state, self.reason = "wait", "nothing seen yet"
        self.place: Vector3 | None = None
        self.distance = math.inf
        self.switches = 0
        self.source_number = 0.0
        self.give = 0.0
        self._by_wrist = False
        self._straying = Straying(self.config.reserve)
        self._takeover = Takeover()
        self._acts = -math.inf

    @property
    def estimate(self) -> TargetEstimate | None:
        """Of the filter."""
        return self.filter.estimate

    @property
    def warning(self) -> str:
        """Which camera lies about time."""
        return self.clocks.words

    @property
    def iterations(self) -> int:
        """It has none: it goes on all the time."""
        return 0

    def see(self, look: Look) -> None:
        """One camera looked."""
        if self.filter.add(look) and self.filter.estimate is not None:
            self.clocks.see(look, self.filter.estimate.at(look.stamp)[0])

    def led(self) -> None:
        """A planned way may end with other joints than the law's own would have."""
        self.law.led()

    def step(self, now: float, joints: JointState, guard: GuardStatus | None) -> Wish | None:
        """What the joints should do now; None to rest."""
        self.law.hear(guard)
        estimate = self.filter.estimate
        if estimate is None:
            return None
        age = now - estimate.seen
        if age > LOST:
            self.state, self.reason = "search", f"target not seen for {age:.1f} s"
            self.place, self.distance = None, math.inf
            return None
        here = self.follow(now, estimate)
        config = self.config
        T = tcp_pose(self.robot, joints.position)
        self.distance = float(np.linalg.norm(here - T[:3, 3])) - config.radius
        self._acts = now + config.law.delay
        at, velocity = estimate.at(self._acts)
        axis, down = tool_direction(config, at, estimate.normal)
        if config.direction == "facing":
            axis = along_the_tool(axis, self.law.pointing)
        tip = tcp_pose(self.robot, self.law.ahead(joints, now))[:3, 3]
        # Nobody presses against what nobody sees: the tip goes back before the permit has to end.
        retreat = min(RETREAT, RETREAT_SPEED * max(age - SEEN_WITHIN, 0.0))
        self._straying.seen(estimate, axis)
        self._straying.predicted(self._acts, at)
        retreat += self._straying.keeps_off(now, self.distance)
        at = at + self._takeover.held
        way, beside = axis, None
        if config.tip is not None and config.radius > 0.0 and config.funnel.gap <= 0.0:
            way, beside = side(tip, at, axis)
        touched = at - (config.radius + retreat + self.give) * way
        most = config.gentle if self.distance < NEAR_BODY else math.inf
        if math.isfinite(config.reserve):
            ahead = self._acts - estimate.stamp
            turns = self._straying.turns(ahead)
            left = float(np.linalg.norm(tip - at)) - config.radius - retreat
            if self._straying.speed > GOES:
                most = min(most, meeting_speed(left, turns))
            goes = float(velocity @ axis)
            # What gives way by its reserve forgives as much of a speed, half of it for the place.
            wrong = max(self._straying.speed_error(ahead) - 0.5 * config.reserve / LATE, 0.0)
            velocity = velocity - min(max(goes, 0.0), wrong) * axis
        aim = touch_aim(tip, touched, velocity, axis, down, config.funnel, beside)
        return Wish(self.law.command(now, joints, aim, most), estimate.seen)

    def before(self, gap: float) -> Pose | None:
        """Of the tip, so far before the target's surface."""
        seen = self.touchable()
        if seen is None:
            return None
        axis, down = tool_direction(self.config, seen.position, seen.normal)
        place = seen.position - (gap + self.config.radius) * axis
        return self.law.pose(Aim(place, np.zeros(3), axis, down))

    def touchable(self) -> Touchable | None:
        """By the estimate, as on the tangent of its way where the command acts.

        On a curve a region that kept the velocity of its exposure would move by 5 cm/s otherwise
        than what the arm goes along with, which is more than may be kept in it.
        """
        e = self.filter.estimate
        if e is None:
            return None
        P, drift = e.covariance, math.sqrt(max(np.linalg.eigvalsh(e.covariance[3:, 3:])[-1], 0.0))
        acts = max(self._acts, e.stamp)
        place, velocity = e.at(acts)
        return Touchable(
            e.stamp, place - velocity * (acts - e.stamp), velocity, P[:3, :3], drift=drift,
            normal=e.normal, along=e.along, seen=e.seen,
        )  # fmt: skip

    def follow(self, now: float, estimate: TargetEstimate) -> Vector3:
        """(3,) where the target is servoed to be now [m], and which sensors say so."""
        by_wrist = now - estimate.wrist_stamp < 0.3
        self.switches += by_wrist != self._by_wrist
        self._by_wrist = by_wrist
        here = estimate.at(now)[0] + self._takeover.update(now, estimate)
        self.place = here
        self.state = "near" if by_wrist else "far"
        self.reason = "the pair sees it" if by_wrist else "fixed cameras"
        self.source_number = 3.0 if by_wrist else 2.0
        return here


class PaperChase:
    """V's Master and V's segments, with or without the pair."""

    def __init__(self, robot: Robot, wrist: bool, config: ChaseConfig) -> None:
        self.robot, self.config = robot, config
        self.master = PaperMaster(wrist=wrist)
        down = -config.vertical
        self.planner = SegmentPlanner(
            robot, config.segments, config.vertical, config.front, down, config.weights,
            downward=config.direction == "down",
        )  # fmt: skip
        self.law = VelocityLaw(robot, config.law, config.weights)
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.master.reset()
        self.planner.reset()
        self.law.reset()
        self.state, self.reason = "wait", "nothing seen yet"
        self.place: Vector3 | None = None
        self.distance = math.inf
        self.source_number = 0.0
        self.give = 0.0
        self._last = -math.inf
        self._stamp = -math.inf
        self._along: Vector3 | None = None

    @property
    def estimate(self) -> TargetEstimate | None:
        """V has none."""
        return None

    @property
    def warning(self) -> str:
        """V compares no cameras."""
        return ""

    @property
    def switches(self) -> int:
        """Changes between eye to hand and eye in hand."""
        return len(self.master.switches)

    @property
    def iterations(self) -> int:
        """Segments begun."""
        return self.planner.iterations

    def led(self) -> None:
        """Its segments begin where the arm is."""
        self.law.led()

    def see(self, look: Look) -> None:
        """One camera looked."""
        self.master.add(look)
        seen = next((s.along for s in look.sightings[:1] if s.along is not None), None)
        self._along = self._along if seen is None else seen

    def step(self, now: float, joints: JointState, guard: GuardStatus | None) -> Wish | None:
        """What the joints should do now; None to rest."""
        self.law.hear(guard)
        choice = self.master.choose(now)
        self.state, self.reason = choice.source.value, choice.reason
        self.source_number = SOURCES[choice.source]
        self.place = choice.position
        config, elapsed = self.config, now - self._last
        self._last = now
        if choice.position is None:
            self.distance = math.inf
            if self.planner.running is None:
                return None
        else:
            self._stamp = max(self._stamp, choice.stamp)
            tip = tcp_pose(self.robot, joints.position)[:3, 3]
            self.distance = float(np.linalg.norm(choice.position - tip)) - config.radius / 3.0
        if now - self._stamp > LASTS:
            return None
        acts = now + config.law.delay
        here = self.law.ahead(joints, now)
        q, v = self.planner.waypoint(acts, here, self._before(choice.position, here))
        error = q - here
        if np.abs(error).max() > 0.06 and math.isfinite(elapsed):
            self.planner.delay(elapsed)
            v = np.zeros_like(v)
        return Wish(v + 6.0 * error, self._stamp)

    def touchable(self) -> Touchable | None:
        """By the Master's choice."""
        if self.place is None:
            return None
        sigma = PAPER_SIGMA**2 * np.eye(3)
        return Touchable(
            self._stamp, self.place, np.zeros(3), sigma, PAPER_MARGIN, PAPER_DRIFT,
            along=self._along,
        )  # fmt: skip

    def before(self, gap: float) -> Pose | None:
        """V knows no planned way."""
        return None

    def _before(self, place: Vector3 | None, here: JointVector) -> Vector3 | None:
        """What is servoed to: the place itself, or before it by the stand-off that is asked for."""
        gap = self.config.funnel.gap
        if place is None or gap <= 0.0:
            return place
        if self.config.direction == "down":
            return np.asarray(place + gap * self.config.vertical)
        axis = facing(place, self.config.vertical, self.config.front)
        return np.asarray(place - gap * axis)


def tool_direction(
    config: ChaseConfig, place: Vector3, normal: Vector3 | None
) -> tuple[Vector3, Vector3]:
    """Where the tool's axis (3,) should point at a place, and its y (3,), both unit."""
    flat = facing(place, config.vertical, config.front)
    if config.direction == "down":
        return -config.vertical, -flat
    pitch = config.pitch
    if config.direction == "facing":
        beside = place - float(place @ config.vertical) * config.vertical
        nearer = (CLOSE[0] - float(np.linalg.norm(beside))) / (CLOSE[0] - CLOSE[1])
        pitch += min(max(nearer, 0.0), 1.0) * max(STEEP - pitch, 0.0)
    axis = math.cos(pitch) * flat - math.sin(pitch) * config.vertical
    if config.direction == "normal" and normal is not None:
        between = math.acos(float(np.clip(-normal @ axis, -1.0, 1.0)))
        share = config.turned * min(1.0, WIDEST / max(between, 1e-6))
        axis = (1.0 - share) * axis - share * normal
        axis = axis / np.linalg.norm(axis)
    return np.asarray(axis), -config.vertical


def make_chase(
    mode: Literal["ours", "paper", "fixed"],
    robot: Robot,
    cameras: Sequence[str],
    wrist: str,
    config: ChaseConfig,
) -> Chase:
    """The chase of a mode."""
    if mode == "ours":
        return OurChase(robot, cameras, wrist, config)
    return PaperChase(robot, mode == "paper", config)
