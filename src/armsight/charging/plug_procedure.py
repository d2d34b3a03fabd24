"""Calibrating a standing pair and the plug by showing the plug to it: moves, looks, the solve.

It knows neither the arm nor the pair: it yields what it wants and is sent what came of it, as the
sphere's procedure does (:mod:`armsight.calibration.live.sphere`). What hangs in a soft mount is
seen as it hangs; what the force sensor feels says how far that is from where the mount holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, JointPath, JointVector, Mask, Pose, Poses
from armsight.calibration.live.seen import LookAt, Looked, MoveTo, Request
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.views import FreeCheck, travel_seconds
from armsight.charging.admittance import Admittance
from armsight.charging.calibrate import (
    LEAST_VIEWS,
    PlugCalibration,
    PlugLook,
    calibrate_by_plug,
    choose_looks,
    uncalibrated,
)
from armsight.charging.eye import picture_fault
from armsight.charging.find import FindOptions
from armsight.charging.hanging import hung
from armsight.charging.plug_views import expected_noise, plug_views
from armsight.charging.pose import CLEAR, PortPose, fit_held, fit_pose, locate
from armsight.devices.data import StereoInfo
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse
from armsight.robots.robot import Robot

POOL = 400
"""Configurations that looks are chosen from."""
FIRST = 9
"""Looks after which pair and plug are known well enough to draw others, and choose them better."""
GOALS = 12
"""Places of the workspace at which the tip has to be right."""
REST = 0.5
"""Before each look: the plug swings in its mount [s]."""
LOOK_SECONDS = 0.8
"""A look lasts, with that rest [s]."""
CARRIES = 3
"""The joints that carry the arm about; the others turn its wrist."""
MUCH = 1.5
"""So many times nearer is much nearer."""
ROUNDS = 3
"""Of taking out how the plug hangs about where it was found to be held."""
SPARE = (0.10, 0.05, 0.0)
"""Of places with so much more room than the guard asks for one is chosen, where there are some:
beside less the arm's own shadow soon holds it [m]."""
SOME = 12
"""So many are some."""
SLOWED = 2.5
"""So many times as long as by itself the arm takes to move where it is slowed now and then."""
LONG = 6.0
"""No place is gone to to which it takes longer, as long as there are others [s]."""
RANGE = (0.3, 1.2)
"""Where a plug is searched that is not where it is expected [m]."""


@dataclass(frozen=True)
class PlugSetup:
    """What is there to calibrate.

    Attributes:
        robot: the arm as believed, the plug its tool: it is moved by this.
        errors: of which arm which errors are solved; None for an arm that is believed as it is.
        pair: that stands, as believed.
        plug: type of the plug.
        mount: in which it hangs; None for a rigid one.
        free: whether the arm may stand at joint angles.
        room: how much farther than the guard asks for the arm would be there from whoever could be
            somewhere, as far as is known now [m].
        lasts: how long the guard makes the way there at least [s]; inf where it lets it not pass.
        here: (n,) where the arm is [rad], where somebody says so.
        looks: how many are taken, with those that are there already.
        speed, acceleration: shares of the arm's limits.
    """

    robot: Robot
    errors: RobotErrors | None
    pair: StereoInfo
    plug: str
    mount: Admittance | None
    free: FreeCheck
    looks: int = 26
    speed: float = 0.5
    acceleration: float = 0.5
    room: Callable[[JointVector], float] = lambda joints: np.inf
    lasts: Callable[[JointVector], float] = lambda joints: 0.0
    here: Callable[[], JointVector | None] = lambda: None

    @property
    def believed(self) -> PlugCalibration:
        """Before the first look."""
        assert self.robot.tool is not None
        errors = self.errors or RobotErrors(self.robot)
        return uncalibrated(self.pair.T_mount_camera, self.robot.tool.T_flange_tcp, errors)


@dataclass(frozen=True, eq=False)
class PlugNews:
    """What a watcher is told after each look, or where there could be none.

    Attributes:
        done, of: looks that count so far, and how many are wanted.
        picture: the left one, grey; None where none came.
        seen: the plug in it, or None; problem: why there is none, in words.
        joints: (n,) of the arm [rad].
        answer: what is believed by now.
    """

    done: int
    of: int
    picture: Bytes | None
    seen: PortPose | None
    problem: str
    joints: JointVector
    answer: PlugCalibration


@dataclass(frozen=True, eq=False)
class PlugResult:
    """What comes of it.

    Attributes:
        answer: pair in base, plug on flange, the arm's errors.
        looks: that were taken; dropped: why others were not, in words.
        sigma: of the tip against what the pair sees, over the places it has to be right at [m].
    """

    answer: PlugCalibration
    looks: tuple[PlugLook, ...]
    dropped: tuple[str, ...]
    sigma: float


Told = Callable[[PlugNews], None]
Kept = Callable[[PlugLook], None]


def plug_procedure(
    setup: PlugSetup,
    rng: np.random.Generator,
    told: Told = lambda news: None,
    kept: Kept = lambda look: None,
    done: Sequence[PlugLook] = (),
) -> Generator[Request, bool | Looked, PlugResult]:
    """Show the plug from many sides, first as believed, then as the first looks have told.

    The arm goes on to the place that tells most per second by the newest map. A place that was not
    reached, or where the plug was not clear, is replaced by another one, up to half as often as
    looks are wanted.

    Args:
        setup: what is there.
        rng: of places.
        told: told of every look.
        kept: told of every one that counts.
        done: looks of a run that was stopped: they count as taken.

    Raises:
        CalibrationError: the plug cannot be shown, was not seen often enough, or its looks
            contradict each other or turn it about one axis only.
    """
    taken = _Taken(setup, told, kept, list(done))
    looks, dropped = taken.looks, taken.dropped
    places: _Places | None = None
    goals = np.array([*(look.joints for look in looks), setup.robot.home])
    while len(looks) < setup.looks and taken.tried < setup.looks + setup.looks // 2:
        if not looks and taken.tried >= FIRST:
            break  # the other places would tell no more
        stage = "look about" if len(looks) < FIRST else "look where it tells most"
        goal = places.next(taken) if places is not None and places.stage == stage else None
        if places is None or goal is None:
            places = _drawn(setup, looks, stage, rng)
            goals, goal = places.goals, places.next(taken)
        yield from taken.look(places.roomiest() if goal is None else goal, stage, places.answer)
    if len(looks) < LEAST_VIEWS and dropped:
        raise CalibrationError(
            f"plug calibration: {len(looks)} good looks of {len(looks) + len(dropped)}, at least "
            f"{LEAST_VIEWS} are needed; most often: {max(set(dropped), key=dropped.count)}"
        )
    answer = _solved(setup, looks, rng)
    sigma = float(np.sqrt(np.mean([answer.tip_sigma(q) ** 2 for q in goals])))
    return PlugResult(answer, tuple(looks), tuple(dropped), sigma)


class _Taken:
    """Looks that were taken, and why others were not.

    Attributes:
        looks: that count; dropped: why others do not; here: (n,) where the arm is [rad].
    """

    def __init__(self, setup: PlugSetup, told: Told, kept: Kept, looks: list[PlugLook]) -> None:
        self._setup, self._told, self._kept = setup, told, kept
        self.looks, self.dropped, self.here = looks, list[str](), setup.robot.home
        self._reached = [look.joints for look in looks] or [self.here]
        self._held: list[JointVector] = []

    @property
    def tried(self) -> int:
        """Places that the arm went to, or could not reach."""
        return len(self.looks) + len(self.dropped)

    def promising(self, joints: JointPath) -> Mask:
        """(c,) bool of (c, n) [rad]: much nearer to where the arm came than to where it was held.

        The map is not seen whole; what keeps the guard from one place keeps it from those beside.
        """
        if not self._held:
            return np.ones(len(joints), bool)

        def away(places: list[JointVector]) -> Floats:
            off = joints[:, None, :CARRIES] - np.array(places)[None, :, :CARRIES]
            return np.asarray(np.abs(off).max(axis=2).min(axis=1))

        return np.asarray(MUCH * away(self._reached) <= away(self._held))

    def look(
        self, goal: JointVector, stage: str, answer: PlugCalibration
    ) -> Generator[Request, bool | Looked, None]:
        """Go there and look."""
        arrived = yield MoveTo(goal, stage)
        (self._reached if arrived else self._held).append(goal)
        if not arrived:
            self._tell(None, None, "the arm did not get there", goal, answer)
            return
        self.here = goal
        looked = yield LookAt((0,), REST, 1)
        assert isinstance(looked, Looked)
        seen, problem = read_look(self._setup, answer, looked)
        if seen is not None:
            T, covariance = seen.T_ref_port, seen.covariance
            self.looks.append(PlugLook(looked.joints, T, covariance, looked.wrench))
            self._kept(self.looks[-1])
        self._tell(looked.pictures[0].color, seen, problem, looked.joints, answer)

    def _tell(
        self,
        picture: Bytes | None,
        seen: PortPose | None,
        problem: str,
        joints: JointVector,
        answer: PlugCalibration,
    ) -> None:
        if problem:
            self.dropped.append(problem)
        count = len(self.looks)
        self._told(PlugNews(count, self._setup.looks, picture, seen, problem, joints, answer))


class _Places:
    """Where looks may be taken, each once.

    Attributes:
        stage: of the procedure; answer: what was believed as they were drawn.
        goals: (t, n) where the tip has to be right [rad].
    """

    def __init__(
        self,
        setup: PlugSetup,
        stage: str,
        answer: PlugCalibration,
        drawn: tuple[JointPath, Poses],
        rng: np.random.Generator,
    ) -> None:
        self.stage, self.answer, self._setup = stage, answer, setup
        self._joints, self._C = drawn
        some = rng.permutation(len(self._joints))[:GOALS]
        self.goals = np.vstack([self._joints[some], setup.robot.home])
        self._left = np.ones(len(self._joints), bool)

    def next(self, taken: _Taken) -> JointVector | None:
        """(n,) that tells most per second [rad]; None: the guard lets the arm go to none."""
        joints, C = self._joints, self._C
        room = np.array([self._setup.room(q) for q in joints])
        hopeful = self._left & taken.promising(joints)
        for spare in SPARE:
            good = np.flatnonzero(hopeful & (room > spare))
            seconds = self._seconds(taken, good)
            if np.isfinite(seconds).sum() < (SOME if spare > 0.0 else 1):
                continue
            near = seconds <= max(LONG, seconds.min())
            good, seconds = good[near], seconds[near]
            there, noise = (joints[good], C[good]), expected_noise(C[good])
            [k] = choose_looks(self.answer, *there, noise, self.goals, 1, taken.looks, seconds)
            self._left[good[k]] = False
            return np.asarray(joints[good[k]])
        return None

    def roomiest(self) -> JointVector:
        """(n,) the roomiest [rad]: the guard lets the arm go nowhere as far as is known."""
        k = int(np.argmax([self._setup.room(q) for q in self._joints]))
        return np.asarray(self._joints[k])

    def _seconds(self, taken: _Taken, which: Ints) -> Floats:
        """(c,) of the ways to these of its places and of the looks there [s]."""
        setup, here, goals = self._setup, self._setup.here(), self._joints[which]
        start = taken.here if here is None else here
        travel = travel_seconds(setup.robot, start, goals, setup.speed, setup.acceleration)
        return np.maximum(SLOWED * travel, [setup.lasts(q) for q in goals]) + LOOK_SECONDS


def _drawn(
    setup: PlugSetup, looks: Sequence[PlugLook], stage: str, rng: np.random.Generator
) -> _Places:
    """Places for looks, as the looks that are there have told."""
    answer = setup.believed
    if len(looks) >= LEAST_VIEWS:
        with suppress(CalibrationError):  # more looks may tell; the end decides
            answer = _solved(setup, looks, rng)
    drawn = plug_views(answer, setup.robot, setup.pair.lenses, setup.plug, POOL, rng, setup.free)
    if len(drawn[0]) < LEAST_VIEWS:
        raise CalibrationError(
            f"the arm can hold its plug before the pair {setup.pair.name} in {len(drawn[0])} "
            f"places only, {LEAST_VIEWS} are needed: check where the pair is said to be, and what "
            "the arm must keep from"
        )
    return _Places(setup, stage, answer, drawn, rng)


def read_look(
    setup: PlugSetup, answer: PlugCalibration, looked: Looked
) -> tuple[PortPose | None, str]:
    """The plug in a look's pictures, or None and why not.

    It is fitted where it is expected, in the roll in which the arm holds it: from aside another
    one may fit as well by its rims alone. It is searched where it is not there.
    """
    picture, pair = looked.pictures[0], setup.pair.lenses
    if picture.color is None or picture.right is None:
        return None, picture.problem or "the pair sent one picture only"
    images = (picture.color, picture.right)
    fault = picture_fault(*images, pair.left, pair.right)
    if fault:
        return None, fault
    lenses, T_lens_ref = (pair.left, pair.right), (np.eye(4), inverse(pair.T_left_right))
    start = inverse(answer.T_base_camera) @ answer.base_tip(looked.joints)
    start = start @ hanging(answer.T_flange_plug, looked.wrench, setup.mount)
    held = fit_held(images, lenses, T_lens_ref, setup.plug, start)
    if held is not None:
        return held, ""
    seen = fit_pose(images, lenses, T_lens_ref, setup.plug, start)
    if seen.score < CLEAR or seen.doubtful:
        found = locate(images, pair, FindOptions((setup.plug,), RANGE))
        if not found:
            return None, f"no {setup.plug} in the pictures"
        seen = found[0]
    if seen.score < CLEAR:
        return None, "the plug is not clear enough"
    if seen.doubtful:
        return None, "the plug's roll cannot be told"
    return seen, ""


def hanging(T_flange_plug: Pose, wrench: Floats | None, mount: Admittance | None) -> Pose:
    """The hanging plug in the frame of where its mount holds it."""
    if mount is None or wrench is None:
        return np.eye(4)
    return np.asarray(inverse(T_flange_plug) @ hung(T_flange_plug, wrench, mount))


def _solved(
    setup: PlugSetup, looks: Sequence[PlugLook], rng: np.random.Generator
) -> PlugCalibration:
    """The bundle of where the mount holds the plug; how it hangs depends on where that is."""
    errors = setup.errors or RobotErrors(setup.robot)
    answer = setup.believed
    for _ in range(ROUNDS if setup.mount is not None else 1):
        held = [
            replace(
                look,
                T_camera_plug=np.asarray(
                    look.T_camera_plug
                    @ inverse(hanging(answer.T_flange_plug, look.wrench, setup.mount))
                ),
            )
            for look in looks
        ]
        answer = calibrate_by_plug(
            errors.robot, held, rng, arm=setup.errors is not None, errors=errors
        )
    return answer
