"""Solving a recorded set: cameras, boards and lenses of it at once, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armsight.calibration.board_turns import settle_turns
from armsight.calibration.boards import Turn
from armsight.calibration.calibrate import Calibration, CalibrationOptions, calibrate
from armsight.calibration.diagnosis.joints import with_agreeing_joints
from armsight.calibration.diagnosis.lens_alone import lens_findings
from armsight.calibration.diagnosis.pictures import picture_findings
from armsight.calibration.diagnosis.poses import pose_findings
from armsight.calibration.diagnosis.solved import diagnose_solution
from armsight.calibration.diagnosis.start import diagnose_start
from armsight.calibration.diagnosis.verdict import verdict_findings
from armsight.calibration.findings import Finding, by_severity, names_of
from armsight.calibration.lens import LensCalibration, calibrate_lens
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.problem import ArmView, BoardPlacement, Lens, Problem, Rig, Sighting
from armsight.calibration.recorded_set import RecordedCamera, RecordedSet
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.rough_lens import rough_lens
from armsight.calibration.solver import SolverOptions
from armsight.errors import CalibrationError
from armsight.robots.robot import Robot

GIVEN = {"focal": 0.003, "aspect": 0.001, "center": 0.003, "distortion": 0.03}
"""What is believed of a lens that somebody calibrated (see ``sheet_prior``): users' lens files are
off by a few pixels in centre and focal length."""
BARE = {**GIVEN, "focal": 0.005, "center": 0.006, "distortion": 0.3}
"""The same without distortion: whoever left it out fitted the rest around it."""
UNKNOWN = {"focal": 0.5, "center": 0.1, "distortion": 1.0}
"""What is believed of a lens of which nothing is known."""


@dataclass(frozen=True)
class RecordedAnswer:
    """What a recorded set says.

    Attributes:
        calibration: cameras and boards; None for a set of lens frames, and where a mistake that
            was found leaves nothing to solve.
        lenses: of a set of lens frames, one a camera; else empty.
        findings: everything odd, mistakes first.
        problem: what the solve began with.
    """

    calibration: Calibration | None
    lenses: tuple[LensCalibration, ...] = ()
    findings: tuple[Finding, ...] = field(default=())
    problem: Problem | None = None


def problem_of(
    recorded: RecordedSet,
    robot: Robot | None = None,
    sigma: float = 0.15,
    keep_lens: bool = False,
) -> Problem:
    """The set as a problem, with the start values by which its poses were read.

    Raises:
        CalibrationError: no board was seen, or no lens is there that could be kept.
    """
    points = recorded.board.points
    poses = recorded.poses
    if poses is None or not any(d is not None for c in recorded.cameras for d in c.seen.detections):
        misses = [m for c in recorded.cameras for m in c.seen.misses if m]
        reasons = sorted(set(misses))
        raise CalibrationError(
            f"{recorded.folder}: no {recorded.board.describe()} in any of {len(misses)} pictures "
            f"({', '.join(reasons) or 'no poses'}); check the board's kind and size"
        )
    rigs, lenses, sightings = [], [], []
    boards: list[BoardPlacement] = []
    for mount in dict.fromkeys(c.mount for c in recorded.cameras):
        carrier = "flange" if mount == "base" else "base"
        name = "board" if len(boards) == 0 else f"board on {carrier}"
        boards.append(BoardPlacement(name, points, carrier))  # type: ignore[arg-type]
    for index, camera in enumerate(recorded.cameras):
        rig, board = _placed(camera, boards)
        rigs.append(rig)
        lenses.append(_lens(camera, index, recorded, keep_lens))
        place = boards.index(board)
        if camera.choice is not None and np.array_equal(board.T_mount_board, np.eye(4)):
            boards[place] = replace(board, T_mount_board=camera.choice.best.fit.Z)
        again = camera.seen.repeated()  # the same picture twice tells nothing twice
        for k, (view, d) in enumerate(zip(camera.view, camera.seen.detections)):
            if (
                d is not None
                and k not in again
                and view >= 0
                and len(d.corner) >= min(5, len(points))
            ):
                sightings.append(Sighting(int(view), index, place, d.corner, d.pixel, sigma))
    if not sightings:
        raise CalibrationError(
            f"{recorded.folder}: no picture that shows the board belongs to a pose; number "
            "pictures and poses alike"
        )
    sightings.sort(key=lambda s: (s.view, s.lens))
    joints = recorded.joints if robot is not None else None
    views = tuple(ArmView(T, None if joints is None else joints[i]) for i, T in enumerate(poses))
    errors = RobotErrors(robot) if joints is not None and robot is not None else None
    problem = Problem(tuple(rigs), tuple(lenses), tuple(boards), views, tuple(sightings), errors)
    return settle_turns(problem, recorded.board.turns)


def without_what_follows(findings: list[Finding], start: list[Finding]) -> list[Finding]:
    """All findings, without those that a lens of another size or views that cannot tell make.

    Where views are alike, many readings of their poses fit alike; with a wrong lens none fits.
    """
    codes = {f.code for f in start if f.severity == "error"}
    if "lens_resolution" in codes:
        findings = [f for f in findings if f.code not in ("poses_do_not_match", "board_size")]
    if codes & {"alike", "one_axis", "few_views"}:
        findings = [f for f in findings if f.code not in READINGS]
        start = [f for f in start if f.code != "lens_resolution"]  # such views tell no lens
    return findings + start


READINGS = (
    *("shifted", "order", "quaternion_order", "matrix_order", "rotation_format", "degrees"),
    *("millimetres", "pose_inverted", "board_size", "poses_do_not_match", "mirrored", "slip"),
    *("two_cameras", "undecided"),
)
"""Codes of mistakes in reading poses."""
HOPELESS = ("poses_do_not_match", "board_poses", "board_size")
"""Codes of mistakes with which a solve tells nothing."""


def unturned(problem: Problem, recorded: RecordedSet) -> tuple[Problem, list[Finding]]:
    """Boards that should tell their order and were yet read turned by half a turn, put right."""
    count = len(recorded.board.points)
    full = all(len(s.corner) == count for s in problem.sightings)
    if recorded.board.turns or not full or any(c.choice is None for c in recorded.cameras):
        return problem, []
    half = (Turn(np.pi, np.arange(count)[::-1]),)
    fixed = settle_turns(problem, half, 3.0)
    bad = [
        recorded.names[a.view]
        for a, b in zip(problem.sightings, fixed.sightings)
        if not np.array_equal(a.pixel, b.pixel)
    ]
    if not bad or len(bad) > 0.5 * len(problem.sightings):
        return problem, []
    found = Finding(
        "flipped",
        "warning",
        f"{names_of(bad)}: the board is read turned by 180 deg; read rightly here",
        "use a board whose corners cannot be confused: a hollow corner square, ChArUco or tags",
    )
    return fixed, [found]


def _placed(camera: RecordedCamera, boards: Sequence[BoardPlacement]) -> tuple[Rig, BoardPlacement]:
    board = next(b for b in boards if (b.mount == "flange") == (camera.mount == "base"))
    T = np.eye(4)
    if camera.choice is not None:
        T = camera.choice.best.fit.X
    return Rig(camera.name, camera.mount, T), board


def _lens(camera: RecordedCamera, rig: int, recorded: RecordedSet, keep: bool) -> Lens:
    assert camera.seen.size is not None
    width, height = camera.seen.size
    given = camera.lens
    if given is None:
        if keep:
            raise CalibrationError(f"{recorded.folder}: no lens there to be kept; give --lens FILE")
        found = [d for d in camera.seen.detections if d is not None]
        lens = rough_lens(recorded.board, found, (width, height))
        return Lens(camera.name, rig, lens, prior=sheet_prior(lens, **UNKNOWN))
    lens = replace(given.camera, width=width, height=height)
    prior = sheet_prior(lens, **(GIVEN if given.bent else BARE))
    if given.sigma is not None:
        prior = np.diag(1 / np.maximum(given.sigma, 1e-9) ** 2)
    return Lens(camera.name, rig, lens, prior=prior, keep=keep)


def solve_set(
    recorded: RecordedSet,
    robot: Robot | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    keep_lens: bool = False,
) -> RecordedAnswer:
    """Solve a recorded set and say what is wrong with it.

    Args:
        recorded: the set.
        robot: model of the arm when the set has joint angles.
        seed: of random samples.
        progress: called with each stage.
        keep_lens: the lens that was given stays as it is, whatever the pictures say.

    Raises:
        CalibrationError: it cannot be solved at all.
    """
    recorded, contradicted = with_agreeing_joints(recorded, robot)
    findings = [
        *recorded.findings,
        *contradicted,
        *picture_findings(recorded),
        *pose_findings(recorded),
    ]
    if recorded.poses is None:
        lenses = _lenses(recorded)
        findings += lens_findings([c.name for c in recorded.cameras], lenses)
        return RecordedAnswer(None, lenses, by_severity(findings))
    problem, turned = unturned(problem_of(recorded, robot, keep_lens=keep_lens), recorded)
    findings += turned
    start = [f for rig in range(len(problem.rigs)) for f in diagnose_start(problem, rig)]
    findings = without_what_follows(findings, start)
    fatal = [f for f in findings if f.severity == "error"]
    if any(f.code in HOPELESS for f in fatal):
        return RecordedAnswer(None, (), by_severity(findings), problem)
    options = CalibrationOptions(
        # A lens that was given is solved as well, with what was given as its prior.
        solve_lenses=True,
        select=True,
        solver=SolverOptions(tolerance=1e-7),
    )
    try:
        answer = calibrate(problem, np.random.default_rng(seed), options, progress)
    except (CalibrationError, np.linalg.LinAlgError) as error:
        if fatal:  # what is wrong has been found: that is the answer
            return RecordedAnswer(None, (), by_severity(findings), problem)
        why = error if isinstance(error, CalibrationError) else "the views determine no solution"
        raise CalibrationError(f"{recorded.folder}: {why}") from None
    if not fatal:
        for rig in range(len(problem.rigs)):
            given = [c.lens is not None for c in recorded.cameras]
            findings += diagnose_solution(answer, rig, recorded.names, seed, given)
        findings += verdict_findings(answer, problem, recorded.names)
    if any(f.code in ("slip", "two_cameras", "rounded", "stale_pose") for f in findings):
        findings = [f for f in findings if f.code != "mostly_left_out"]  # has its cause
    return RecordedAnswer(answer, (), by_severity(findings), problem)


def _lenses(recorded: RecordedSet) -> tuple[LensCalibration, ...]:
    out = []
    for camera in recorded.cameras:
        frames = [(d.corner, d.pixel) for d in camera.seen.detections if d is not None]
        if not frames or camera.seen.size is None:
            why = ", ".join(sorted({m for m in camera.seen.misses if m}))
            raise CalibrationError(
                f"{recorded.folder}: no {recorded.board.describe()} in any picture of "
                f"{camera.name} ({why}); check the board's kind and size"
            )
        try:
            out.append(calibrate_lens(recorded.board.points, frames, *camera.seen.size))
        except CalibrationError as error:
            raise CalibrationError(f"{recorded.folder}: {error}") from None
    return tuple(out)
