"""The procedure: find, tilt, then look where it teaches most, until the goal is reached.

It knows neither the arm nor the cameras: it yields what it wants (:class:`MoveTo`, :class:`LookAt`)
and is sent what came of it, so that a simulator, the guard or a person with a teach pendant can
carry it out, and it can stop and go on at any view. ``PaperSchedule`` keeps T1's stages; ours adds
the choice by information (design page, 5.6).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats, Ints, JointVector, Pose
from armsight.calibration import arm, se3
from armsight.calibration.boards import Board, Checkerboard, Detection, Miss
from armsight.calibration.calibrate import (
    Calibration,
    CalibrationOptions,
    calibrate,
)
from armsight.calibration.depth import (
    DepthModel,
    DepthSamples,
    fit_depth,
    plane_depth,
    read_squares,
)
from armsight.calibration.findings import Finding
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.problem import (
    ArmView,
    BoardPlacement,
    Lens,
    Problem,
    Rig,
    Sighting,
)
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.solver import SolverOptions
from armsight.calibration.views import (
    FreeCheck,
    board_in_view,
    choose,
    information,
    propose,
    target_weight,
    travel_seconds,
)
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class CameraSetup:
    """A camera as believed before calibration.

    Attributes:
        name: of the camera.
        infrared, color: lenses by the sheet (colour None for a camera without).
        T_infrared_color: colour lens in the infrared one by the sheet.
        keep: the lenses are factory calibrated and kept.
        depth_scale: infrared picture's pixels a depth pixel.
    """

    name: str
    infrared: PinholeCamera
    color: PinholeCamera | None
    T_infrared_color: Pose
    keep: bool = False
    depth_scale: float = 1.0


@dataclass(frozen=True)
class MoveTo:
    """Bring the arm to rest at joint angles. Reply: whether it arrived."""

    joints: JointVector
    stage: str


@dataclass(frozen=True)
class LookAt:
    """Photograph with some cameras. Reply: :class:`Looked`.

    Attributes:
        cameras: indices; rest: stand still for this long first [s]; frames: exposures to average.
    """

    cameras: tuple[int, ...]
    rest: float
    frames: int


@dataclass(frozen=True)
class Picture:
    """What a camera delivered: grey pictures and depth, None for what it has not.

    ``problem`` says why there is nothing at all, such as a lost camera.
    """

    color: Bytes | None
    infrared: Bytes | None
    depth: DepthImage | None
    problem: str = ""


@dataclass(frozen=True)
class Looked:
    """The reply to :class:`LookAt`: (n,) joint angles that the arm reported meanwhile, pictures."""

    joints: JointVector
    pictures: list[Picture]


@dataclass(frozen=True)
class SeenView:
    """One view that was taken, small enough to be kept in a file.

    Attributes:
        joints: (n,) as the arm reported [rad].
        stage: in which it was taken; stamp: when [s].
        found: (lens index, corner indices, pixels) of each lens that saw the board.
        missed: (lens index, reason) of those that did not.
        depth: of each camera that has one, (camera, pixels, median depths).
    """

    joints: JointVector
    stage: str
    stamp: float
    found: tuple[tuple[int, Ints, Floats], ...]
    missed: tuple[tuple[int, str], ...] = ()
    depth: tuple[tuple[int, Floats, Floats], ...] = ()


@dataclass(frozen=True)
class Setup:
    """What is there to calibrate.

    Attributes:
        robot: the arm with its tool; cameras: as believed; board: which.
        T_flange_board: of the board's middle, a guess (T1: the flange's centre, facing out).
        free: whether the arm may stand at joint angles; None trusts it everywhere.
        path: whether it may go straight from one configuration to another; None trusts it.
        speed, acceleration: share of the arm's limits that moves use.
        frame_seconds: between exposures [s].
    """

    robot: Robot
    cameras: tuple[CameraSetup, ...]
    board: Board
    T_flange_board: Pose
    free: FreeCheck | None = None
    path: Callable[[JointVector, JointVector], bool] | None = None
    speed: float = 0.5
    acceleration: float = 0.6
    frame_seconds: float = 1 / 15


@dataclass(frozen=True)
class ProcedureOptions:
    """How thorough to be.

    Attributes:
        goal: stop when the expected target error of every lens is below this [m].
        patience: stop when three more views lower the worst lens's error by less than this share.
        most_views: stop after so many views; least_views: not before.
        rest: before each picture [s]; frames: averaged.
        sweep_step: between stops of the base sweep [rad].
        candidates: considered for each view.
        seconds: stop after this robot time [s].
        paper: T1's stages instead of choice by information.
    """

    goal: float = 0.0012
    patience: float = 0.06
    most_views: int = 60
    least_views: int = 15
    rest: float = 0.2
    frames: int = 3
    sweep_step: float = float(np.deg2rad(28))
    candidates: int = 80
    seconds: float = float("inf")
    paper: bool = False


@dataclass(frozen=True)
class Progress:
    """Where the procedure stands, for the page and the terminal.

    Attributes:
        stage: in words; views: taken; seen: (L,) boards seen by each lens.
        expected: (L,) expected target error [m], NaN before the first solve.
        answer: the present estimate, once there is one.
    """

    stage: str
    views: int
    seen: tuple[int, ...]
    expected: tuple[float, ...]
    answer: Calibration | None = None


class Watcher(Protocol):
    """Told of everything that happens."""

    def stage(self, progress: Progress) -> None:
        """A step of the procedure."""
        ...

    def view(self, view: SeenView) -> None:
        """A view was taken: write it down, so that a stopped calibration can go on."""
        ...


class Silent:
    """Watches nothing."""

    def stage(self, progress: Progress) -> None:
        """Ignore."""

    def view(self, view: SeenView) -> None:
        """Ignore."""


@dataclass(frozen=True)
class LiveResult:
    """What the procedure ends with.

    Attributes:
        calibration: lenses, cameras, board, arm.
        depth: of each camera, or None.
        views: all that were taken.
        findings: cameras without enough views and why, cameras that hang upside down.
        stopped: why it ended.
    """

    calibration: Calibration
    depth: tuple[DepthModel | None, ...]
    views: tuple[SeenView, ...]
    findings: tuple[Finding, ...]
    stopped: str


Request = MoveTo | LookAt
Procedure = Generator[Request, "bool | Looked", LiveResult]


@dataclass
class _Log:
    setup: Setup
    options: ProcedureOptions
    watcher: Watcher
    clock: Callable[[], float]
    views: list[SeenView] = field(default_factory=list)
    reasons: set[str] = field(default_factory=set)
    at: JointVector | None = None


def lens_list(cameras: Sequence[CameraSetup]) -> list[Lens]:
    """Lenses of all cameras: infrared first, then colour, camera by camera."""
    out: list[Lens] = []
    for index, c in enumerate(cameras):
        out.append(
            Lens(
                f"{c.name} infrared", index, c.infrared, prior=sheet_prior(c.infrared), keep=c.keep
            )
        )
        if c.color is not None:
            out.append(
                Lens(
                    f"{c.name} color",
                    index,
                    c.color,
                    c.T_infrared_color,
                    not c.keep,
                    sheet_prior(c.color),
                    keep=c.keep,
                )
            )
    return out


def problem_of(setup: Setup, views: Sequence[SeenView]) -> Problem:
    """The views as a problem with the sheet's start values."""
    arm_views, sightings = [], []
    for index, view in enumerate(views):
        T = arm.flange_poses(setup.robot, view.joints[None])[0]
        arm_views.append(ArmView(T, view.joints, stamp=view.stamp))
        for lens, corner, pixel in view.found:
            sightings.append(Sighting(index, lens, 0, np.asarray(corner, np.int64), pixel, 0.1))
    return Problem(
        tuple(Rig(c.name) for c in setup.cameras),
        tuple(lens_list(setup.cameras)),
        (BoardPlacement("board", setup.board.points),),
        tuple(arm_views),
        tuple(sightings),
        RobotErrors(setup.robot),
    )


def procedure(
    setup: Setup,
    options: ProcedureOptions,
    rng: np.random.Generator,
    watcher: Watcher | None = None,
    clock: Callable[[], float] = lambda: 0.0,
    done: Sequence[SeenView] = (),
) -> Procedure:
    """Calibrate everything from cold; yields requests and is sent their replies.

    Args:
        setup: what is there.
        options: how thorough.
        rng: of candidates and samples.
        watcher: told what happens.
        clock: the cell's time [s].
        done: views of an earlier run that was stopped: it goes on from them.

    Raises:
        CalibrationError: no camera ever sees the board, or too little to solve.
    """
    log = _Log(setup, options, watcher or Silent(), clock, list(done))
    began = clock()
    # A stage that was cut short is begun anew; what it saw before is kept.
    stages = {view.stage for view in log.views}
    if not stages & {"learn", "cover"}:
        if "tilt" not in stages:
            yield from _find(log)
        yield from _tilt(log)
    answer = _solve(log, rng)
    _report(log, "first estimate", answer)
    stopped = ""
    if options.paper:
        yield from _cover(log, answer)
        stopped = "T1's trajectory is done"
    else:
        stopped = yield from _learn(log, answer, rng, began)
    return finish(setup, log.views, rng, stopped)


def finish(
    setup: Setup, views: Sequence[SeenView], rng: np.random.Generator, stopped: str = ""
) -> LiveResult:
    """Solve all views with the left-out test, then the depth models."""
    problem = problem_of(setup, views)
    answer = calibrate(problem, rng, CalibrationOptions())
    findings = (*_unseen(setup, problem, views), *_upside_down(answer))
    return LiveResult(
        answer, depth_models(setup, answer, views), tuple(views), tuple(findings), stopped
    )


def _unseen(setup: Setup, problem: Problem, views: Sequence[SeenView]) -> list[Finding]:
    """Cameras that saw the board never, or too seldom, and why."""
    out = []
    for index, camera in enumerate(setup.cameras):
        lenses = {k for k, lens in enumerate(problem.lenses) if lens.rig == index}
        count = len({s.view for s in problem.sightings if s.lens in lenses})
        if count >= 3:
            continue
        reasons = [reason for v in views for k, reason in v.missed if k in lenses]
        why = f" (mostly: {max(set(reasons), key=reasons.count)})" if reasons else ""
        times = "never saw the board" if count == 0 else f"saw the board in {count} views only"
        out.append(
            Finding(
                "camera_unseen",
                "warning",
                f"camera {camera.name} {times}{why}; three views are the least",
                "turn it towards the arm, or check its picture, the light and the board's kind",
            )
        )
    return out


def _upside_down(answer: Calibration) -> list[Finding]:
    """Cameras whose picture stands on its head: fine for the solve, worth knowing for people."""
    seen = {answer.problem.lenses[s.lens].rig for s in answer.problem.sightings}
    return [
        Finding(
            "upside_down",
            "note",
            f"camera {rig.name} hangs upside down",
            "nothing to do: its pose says so; turn its picture where people look at it",
        )
        for index, rig in enumerate(answer.problem.rigs)
        if index in seen and rig.mount == "base" and answer.camera_pose(index)[2, 1] > 0.5
    ]


def depth_models(
    setup: Setup, answer: Calibration, views: Sequence[SeenView]
) -> tuple[DepthModel | None, ...]:
    """Depth model of each camera from the boards' solved places."""
    out = []
    arms, _ = answer.solution.model.arm_poses(answer.solution.state)
    for index, camera in enumerate(setup.cameras):
        lens_index = answer.main_lens(index)
        lens = answer.lens(lens_index)
        if camera.depth_scale != 1.0:
            lens = lens.scaled(1 / camera.depth_scale)
        samples = []
        seen = {s.view for s in answer.problem.sightings if s.lens == lens_index}
        for v, view in enumerate(views):
            if v not in seen:
                continue
            for c, pixel, z in view.depth:
                if c != index or not len(z):
                    continue
                T = inverse(answer.camera_pose(index)) @ arms[v] @ answer.board_pose()
                true = plane_depth(T, pixel, lens)
                samples.append(DepthSamples(pixel, z, true, np.full(len(z), 0.0015)))
        out.append(fit_depth(samples, lens))
    return tuple(out)


# ---------------------------------------------------------------------- looking


def _go(log: _Log, joints: JointVector, stage: str) -> Generator[Request, object, bool]:
    setup = log.setup
    if setup.free is not None and not setup.free(joints):
        return False
    here = log.at if log.at is not None else setup.robot.home
    if setup.path is not None and not setup.path(here, joints):
        return False
    arrived = yield MoveTo(joints, stage)
    if arrived:
        log.at = joints
    return bool(arrived)


def _look(
    log: _Log, stage: str, rest: float | None = None, frames: int | None = None
) -> Generator[Request, object, SeenView]:
    cameras = tuple(range(len(log.setup.cameras)))
    options = log.options
    looked = yield LookAt(
        cameras,
        options.rest if rest is None else rest,
        options.frames if frames is None else frames,
    )
    assert isinstance(looked, Looked)
    view = read_pictures(log.setup, looked.joints, stage, log.clock(), looked.pictures)
    log.reasons.update(reason for _, reason in view.missed if reason)
    if view.found:
        log.views.append(view)
        log.watcher.view(view)
    return view


def read_pictures(
    setup: Setup, joints: JointVector, stage: str, stamp: float, pictures: Sequence[Picture]
) -> SeenView:
    """Find the board in every picture, and read the depth on it."""
    lenses = lens_list(setup.cameras)
    found, missed, depths = [], [], []
    for camera, picture in enumerate(pictures):
        for index, lens in enumerate(lenses):
            if lens.rig != camera:
                continue
            gray = picture.infrared if lens.name.endswith("infrared") else picture.color
            if gray is None:
                missed.append((index, picture.problem or "no picture"))
                continue
            result = setup.board.detect(gray)
            if isinstance(result, Miss):
                missed.append((index, result.reason))
                continue
            found.append((index, result.corner, result.pixel))
            if lens.name.endswith("infrared") and picture.depth is not None:
                scale = setup.cameras[camera].depth_scale
                pixel, z = _board_depth(setup.board, result, picture.depth, scale)
                if len(z):
                    depths.append((camera, pixel, z))
    return SeenView(
        np.asarray(joints, float), stage, stamp, tuple(found), tuple(missed), tuple(depths)
    )


def _board_depth(
    board: Board, seen: Detection, depth: DepthImage, scale: float
) -> tuple[Floats, Floats]:
    if not isinstance(board, Checkerboard):
        return np.zeros((0, 2)), np.zeros(0)
    across, down = board.inner
    grid = np.full((across * down, 2), np.nan)
    grid[seen.corner] = seen.pixel
    j, i = np.mgrid[0 : down - 1, 0 : across - 1]
    # The first inner square lies diagonally inside the (dark) corner square: it is dark as well.
    white = (i + j) % 2 == 1
    return read_squares(depth, grid.reshape(down, across, 2), white, scale)


def _report(log: _Log, stage: str, answer: Calibration | None = None) -> None:
    lenses = lens_list(log.setup.cameras)
    seen = tuple(
        sum(any(k == index for k, _, _ in v.found) for v in log.views)
        for index in range(len(lenses))
    )
    nan = float("nan")
    expected = tuple(
        answer.target_sigma(k) if answer is not None and seen[k] >= 3 else nan
        for k in range(len(lenses))
    )
    log.watcher.stage(Progress(stage, len(log.views), seen, expected, answer))


# ---------------------------------------------------------------------- stages


def _facing_out(setup: Setup) -> JointVector:
    """The upside-down L: the board in front of the arm at half reach, facing away from it."""
    robot = setup.robot
    rng = np.random.default_rng(0)
    best: tuple[float, JointVector] | None = None
    places = [(h, o) for h in (0.55, 0.45, 0.65, 0.35) for o in (0.5, 0.6, 0.4)]
    for height, out in places:
        T = np.eye(4)
        # Board: z away from the viewer, that is towards the base; y down.
        T[:3, :3] = np.column_stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
        T[:3, 3] = [out * robot.reach + 0.1, 0.0, height * robot.reach]
        flange = T @ inverse(setup.T_flange_board @ make_pose(None, _middle(setup)))
        q, ok = arm.reach_some(robot, np.repeat(flange[None], 6, axis=0), rng, 3)
        for x in q[ok]:
            if setup.free is not None and not setup.free(x):
                continue
            far = float(np.abs(x - robot.home).sum())
            if setup.path is not None and not setup.path(robot.home, x):
                far += 100.0  # only if nothing can be reached straight
            if best is None or far < best[0]:
                best = (far, x)
        if best is not None and best[0] < 100.0:
            return best[1]
    if best is not None:
        return best[1]
    raise CalibrationError(
        "calibration: the arm cannot hold the board in front of itself; check the tool, the "
        "board's place on the flange and the solids about the arm"
    )


def _middle(setup: Setup) -> Floats:
    p = setup.board.points
    return np.asarray(0.5 * (p.max(0) + p.min(0)))


def _find(log: _Log) -> Generator[Request, object, None]:
    """Turn the base; all cameras watch (T1's first stage)."""
    setup = log.setup
    q0 = _facing_out(setup)
    low = max(setup.robot.limits.lower[0], -np.pi)
    high = min(setup.robot.limits.upper[0], np.pi)
    angles = np.arange(low + 0.05, high, log.options.sweep_step)
    # From the end that is nearer.
    start = log.at if log.at is not None else setup.robot.home
    if abs(angles[-1] - start[0]) < abs(angles[0] - start[0]):
        angles = angles[::-1]
    # First into the L before the arm, then round: so that the way is a plain turn of the base.
    yield from _go(log, q0, "find")
    behind = 0
    for a in angles:
        q = q0.copy()
        q[0] = a
        if all(c >= 2 for c in _rig_counts(log)) and behind >= 2:
            break  # every camera has seen it, and the board has turned away from all of them
        before = len(log.views)
        if (yield from _go(log, q, "find")):
            yield from _look(log, "find", rest=0.1, frames=1)
            behind = 0 if len(log.views) > before else behind + 1
            _report(log, f"looking for the board, base at {np.rad2deg(a):.0f} deg")
    if not any(v.found for v in log.views):
        reasons = sorted(log.reasons)
        raise CalibrationError(
            "no camera saw the board while the base turned: check the board's kind and size"
            + (f" ({', '.join(reasons[:3])})" if reasons else "")
            + ", the light, and that cameras look at the arm"
        )


def _rig_counts(log: _Log) -> list[int]:
    """Views in which each camera saw the board."""
    lenses = lens_list(log.setup.cameras)
    return [
        sum(any(lenses[k].rig == rig for k, _, _ in v.found) for v in log.views)
        for rig in range(len(log.setup.cameras))
    ]


def _best_views(log: _Log) -> dict[int, SeenView]:
    """Of each camera, the view with the board nearest to the image's centre."""
    lenses = lens_list(log.setup.cameras)
    best: dict[int, tuple[float, SeenView]] = {}
    for view in log.views:
        for lens, _, pixel in view.found:
            c = lenses[lens].camera
            off = np.linalg.norm((pixel.mean(0) - [c.cx, c.cy]) / c.width)
            rig = lenses[lens].rig
            if rig not in best or off < best[rig][0]:
                best[rig] = (float(off), view)
    return {rig: view for rig, (_, view) in best.items()}


def _tilted(log: _Log, view: SeenView, axis: int, angle: float) -> JointVector | None:
    """Joint angles that turn the board about one of its axes through its middle."""
    setup = log.setup
    T = arm.flange_poses(setup.robot, view.joints[None])[0]
    middle = setup.T_flange_board @ make_pose(None, _middle(setup))
    twist = np.zeros((1, 6))
    twist[0, 3 + axis] = angle
    target = T @ middle @ se3.exps(twist)[0] @ inverse(middle)
    q, ok = arm.reach(setup.robot, target[None], view.joints[None])
    return q[0] if ok[0] and np.abs(q[0] - view.joints).max() < 1.5 else None


def _tilt(log: _Log) -> Generator[Request, object, None]:
    """Tilt before a camera: roll, pitch, yaw, which tell where the board hangs.

    All cameras watch; before those that have seen enough by then no tilting of their own is needed.
    """
    lenses = lens_list(log.setup.cameras)
    best = _best_views(log)
    # First where most lenses see the board at once.
    for rig, view in sorted(best.items(), key=lambda item: (-len(item[1].found), item[0])):
        if log.views[-1].stage == "tilt" and _rig_counts(log)[rig] >= 4:
            continue
        name = log.setup.cameras[rig].name
        for axis, steps in ((0, (0.4, -0.4)), (1, (0.4, -0.4)), (2, (0.5,))):
            for angle in steps:
                for share in (1.0, 0.5):
                    q = _tilted(log, view, axis, angle * share)
                    if q is None or not (yield from _go(log, q, "tilt")):
                        continue
                    seen = yield from _look(log, "tilt")
                    _report(log, f"tilting before camera {name}")
                    if any(lenses[k].rig == rig for k, _, _ in seen.found):
                        break


def _solve(log: _Log, rng: np.random.Generator) -> Calibration:
    # Good enough to choose the next view; the last solve of all is exact.
    quick = SolverOptions(iterations=20, tolerance=1e-5)
    options = CalibrationOptions(left_out=False, solver=quick)
    return calibrate(
        problem_of(log.setup, log.views), np.random.default_rng(rng.integers(1 << 31)), options
    )


def _learn(
    log: _Log, answer: Calibration, rng: np.random.Generator, began: float
) -> Generator[Request, object, str]:
    """View after view, each the most useful one, until the goal (ours)."""
    setup, options = log.setup, log.options
    since, failures, checked = 0, 0, 0
    solution = answer.solution
    S = solution.normal.reduced()
    W = target_weight(solution, solution.normal.free)
    best_before = np.inf
    while True:
        if since >= 3 or (since >= 1 and len(log.views) < 18):
            answer = _solve(log, rng)
            solution = answer.solution
            S = solution.normal.reduced()
            W = target_weight(solution, solution.normal.free)
            since = 0
            _report(log, "learning", answer)
            worst = max(answer.target_sigma(k) for k in range(len(answer.problem.lenses)))
            if len(log.views) >= options.least_views:
                if worst < options.goal:
                    return f"the goal is reached: {1e3 * worst:.2f} mm"
                if len(log.views) >= checked + 3:
                    if worst > (1 - options.patience) * best_before:
                        return f"further views teach little: {1e3 * worst:.2f} mm"
                    best_before, checked = worst, len(log.views)
        if len(log.views) >= options.most_views:
            return f"{len(log.views)} views are enough"
        if log.clock() - began > options.seconds:
            return "the time is spent"
        margin = _margin(answer)
        offers = propose(
            answer.problem,
            solution.state,
            setup.robot,
            rng,
            options.candidates,
            setup.free,
            near=log.at,
            margin=margin,
        )
        if not len(offers):
            return "no further view can be reached"
        looks = information(
            answer.problem,
            solution.state,
            answer.freedom,
            setup.robot,
            offers,
            margin=margin,
            sigma=answer.corner_sigma(),
        )
        here = log.at if log.at is not None else setup.robot.home
        fixed = options.rest + options.frames * setup.frame_seconds
        seconds = travel_seconds(setup.robot, here, offers, setup.speed, setup.acceleration) + fixed
        # The best view may lie behind something: then the next best that can be reached straight.
        left = np.arange(len(offers))
        choice, gone = None, False
        while len(left) and not gone:
            choice = choose(S, W, looks.only(left), seconds[left])
            gone = yield from _go(log, offers[left[choice.index]], "learn")
            if not gone:
                left = np.delete(left, choice.index)
        if choice is None or not gone:
            failures += 1
            if failures > 5:
                return "no further view can be reached"
            continue
        taken = int(left[choice.index])
        before = len(log.views)
        view = yield from _look(log, "learn")
        if len(log.views) == before:
            failures += 1
            if failures > 8:
                return f"the board is not seen where it should be ({_main_reason(view)})"
            continue
        S = S + looks.information[taken]
        since += 1


def _main_reason(view: SeenView) -> str:
    reasons = [reason for _, reason in view.missed]
    return max(set(reasons), key=reasons.count) if reasons else "no camera"


def _margin(answer: Calibration) -> float:
    """Three sigma of where the board will be in the worst lens, and 8 px [px]."""
    worst = 0.0
    for lens in range(len(answer.problem.lenses)):
        f = answer.problem.lenses[lens].camera.fx
        worst = max(worst, 3 * answer.target_sigma(lens) * f)
    return 8.0 + min(worst, 60.0)


def _cover(log: _Log, answer: Calibration) -> Generator[Request, object, None]:
    """T1's staged trajectory: outward from the centre, again 20 % farther, camera by camera."""
    schedule = PaperSchedule()
    for rig, view in sorted(_best_views(log).items()):
        name = log.setup.cameras[rig].name
        limits = yield from _tilt_limits(log, rig, view)
        for place, distance, tilt in schedule.views(limits):
            q = _show_at(log, answer, rig, place, distance, tilt)
            if q is None or not (yield from _go(log, q, "cover")):
                continue
            yield from _look(log, "cover")
            if len(log.views) % schedule.solve_every == 0:
                answer = _solve(log, np.random.default_rng(len(log.views)))
            _report(log, f"covering the image of camera {name}", answer)


def _tilt_limits(log: _Log, rig: int, view: SeenView) -> Generator[Request, object, Floats]:
    """(3, 2) greatest tilts, negative and positive, in 5 deg steps until detection fails [rad]."""
    lenses = lens_list(log.setup.cameras)
    limits = np.zeros((3, 2))
    step = np.deg2rad(5)
    for axis in (2, 0, 1):
        for side, sign in ((0, -1.0), (1, 1.0)):
            most = np.deg2rad(45)
            for k in range(1, round(most / step) + 1):
                q = _tilted(log, view, axis, sign * k * step)
                if q is None or not (yield from _go(log, q, "tilt")):
                    break
                seen = yield from _look(log, "tilt")
                if not any(lenses[i].rig == rig for i, _, _ in seen.found):
                    break
                limits[axis, side] = sign * k * step
    return limits


def _show_at(
    log: _Log, answer: Calibration, rig: int, place: Floats, distance: float, tilt: Floats
) -> JointVector | None:
    """Joint angles that show the board at a place of a camera's image (shares of its half size)."""
    setup = log.setup
    lens_index = answer.main_lens(rig)
    lens = answer.lens(lens_index)
    u = np.array(
        [[(0.5 + 0.5 * place[0]) * (lens.width - 1), (0.5 + 0.5 * place[1]) * (lens.height - 1)]]
    )
    ray = np.append(lens.normalise(u)[0], 1.0)
    turn = se3.exps(np.array([[0, 0, 0, *tilt]]))[0]
    T = make_pose(None, ray * distance) @ turn @ make_pose(None, -_middle(setup))
    flange = (
        answer.camera_pose(rig) @ answer.lens_pose(lens_index) @ T @ inverse(answer.board_pose())
    )
    near = log.at if log.at is not None else setup.robot.home
    q, ok = arm.reach(setup.robot, flange[None], near[None])
    if not ok[0]:
        return None
    inside, _ = board_in_view(
        answer.problem, answer.solution.state, arm.flange_poses(setup.robot, q), lens_index, 6.0
    )
    return q[0] if inside[0] else None


@dataclass(frozen=True)
class PaperSchedule:
    """T1's trajectory before one camera.

    Attributes:
        distance: of the first pass [m]; farther: factor of the second.
        stages: rings outward from the image's centre; overlap: boards may overlap between places.
        tilts: views a place, tilted each way in turn; 0 keeps the board parallel to the image.
        solve_every: views between refinements of the running estimate.
    """

    distance: float = 0.85
    farther: float = 1.2
    stages: int = 2
    overlap: bool = False
    tilts: int = 1
    solve_every: int = 4

    def views(self, limits: Floats) -> list[tuple[Floats, float, Floats]]:
        """(place in the image -1..1, distance [m], tilt [rad]) of each view, in order.

        Args:
            limits: (3, 2) greatest tilts about x, y, z, negative and positive [rad].
        """
        out = []
        turn = 0
        for factor in (1.0, self.farther):
            for ring in range(self.stages + 1):
                count = 1 if ring == 0 else (8 if self.overlap else 4) * ring
                for k in range(count):
                    angle = 2 * np.pi * (k + 0.5 * (ring % 2)) / count
                    r = 0.75 * ring / max(self.stages, 1)
                    place = r * np.array([np.cos(angle), np.sin(angle)])
                    tilts = [np.zeros(3)]
                    if self.tilts:
                        tilts = []
                        for _ in range(self.tilts):
                            axis, side = (0, 1, 2)[turn % 3], (turn // 3) % 2
                            t = np.zeros(3)
                            t[axis] = 0.8 * limits[axis, side]
                            tilts.append(t)
                            turn += 1
                    out += [(place, self.distance * factor, t) for t in tilts]
        return out


class Mover(Protocol):
    """What moves the arm: the guard in a running cell, a driver of its own in a simulation."""

    def move(self, joints: JointVector) -> bool:
        """Bring the arm to rest there; False if it cannot or may not."""
        ...

    def joints(self) -> JointVector:
        """(n,) where the arm says it is [rad]."""
        ...

    def now(self) -> float:
        """The cell's time [s]."""
        ...


class Eyes(Protocol):
    """What takes the pictures."""

    def look(self, cameras: tuple[int, ...], rest: float, frames: int) -> list[Picture]:
        """Wait until the arm has rested, and photograph with some cameras."""
        ...


def drive(steps: Procedure, mover: Mover, eyes: Eyes) -> LiveResult:
    """Carry a procedure out."""
    reply: bool | Looked | None = None
    try:
        while True:
            request = steps.send(reply) if reply is not None else next(steps)
            if isinstance(request, MoveTo):
                reply = mover.move(request.joints)
            else:
                pictures = eyes.look(request.cameras, request.rest, request.frames)
                reply = Looked(mover.joints(), pictures)
    except StopIteration as end:
        result: LiveResult = end.value
        return result


__all__ = [
    "CameraSetup",
    "Eyes",
    "LiveResult",
    "LookAt",
    "MoveTo",
    "Mover",
    "PaperSchedule",
    "Picture",
    "ProcedureOptions",
    "Progress",
    "SeenView",
    "Setup",
    "Watcher",
    "drive",
    "finish",
    "procedure",
    "replace",
]
