"""Real hand-eye sets, beside the figures published with them. Without the data it says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.boards import TagGrid
from armsight.calibration.calibrate import Calibration
from armsight.calibration.closed_form import mean_pose
from armsight.calibration.left_out import left_out_errors
from armsight.calibration.model_selection import Trial
from armsight.calibration.noise import solve_with_noise
from armsight.calibration.problem import Freedom
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import problem_of, solve_set
from armsight.calibration.start import arm_for, find_start, planar_poses
from armsight.errors import CalibrationError
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.geometry.pose import inverse

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "calibration"
"""Beside the checkout; never part of it."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """Solve both sets; ``runs`` is not used: the data are what they are."""
    if not DATA.is_dir():
        raise CalibrationError(
            f"{DATA}: the real sets are not beside this checkout; see docs/calibration.md for "
            "where they come from"
        )
    progress("ROS-Industrial, ChArUco", 0.0)
    rows, notes = ros_industrial(seed)
    progress("ViSP, AprilTag", 0.6)
    more, more_notes = visp(seed)
    return Outcome((*rows, *more), {}, (*notes, *more_notes))


def ros_industrial(seed: int) -> tuple[list[Row], list[str]]:
    """ABB arm, ChArUco board on the flange, camera beside it: 15 usable images."""
    answer = solve_set(load(DATA / "ros_industrial_charuco"), seed=seed).calibration
    assert answer is not None
    assert answer.selection is not None
    best = answer.selection.best
    plain = Freedom(lens=False, shape=False, white=None)
    theirs, _ = solve_with_noise(answer.problem, plain)
    views = len(answer.problem.used_views)
    exact = left_out_errors(theirs.model.problem, plain, theirs, views)
    ours = left_out_errors(answer.problem, answer.freedom, answer.solution, views)
    condition = "ChArUco, ABB arm, 15 images"
    measure = "mean distance on the board's plane between the seen ray and the corner"
    rows = [
        Row(
            "ros_seen_mm",
            measure,
            f"{condition}, their model (lens as given, exact arm)",
            exact.mm_all,
            "mm",
            n=_views(answer),
            paper=0.956,
        ),
        Row(
            "ros_left_out_mm",
            f"{measure}, views left out of the solve",
            f"{condition}, their model",
            exact.mm,
            "mm",
            n=_views(answer),
        ),
        Row(
            "ros_seen_px",
            "rms distance of corners",
            f"{condition}, their model",
            exact.px_all,
            "px",
            n=_views(answer),
            paper=1.25,
        ),
        Row(
            "ros_seen_mm",
            measure,
            f"{condition}, model chosen by left-out views: {best.name}",
            ours.mm_all,
            "mm",
            n=_views(answer),
            paper=0.956,
        ),
        Row(
            "ros_seen_px",
            "rms distance of corners",
            f"{condition}, {best.name}",
            ours.px_all,
            "px",
            n=_views(answer),
            paper=1.25,
        ),
        Row(
            "ros_left_out_mm",
            f"{measure}, views left out of the solve",
            f"{condition}, {best.name}",
            ours.mm,
            "mm",
            n=_views(answer),
            must=0.75,
            aim=0.60,
        ),
    ]
    notes = [_notes("ros_industrial_charuco", answer)]
    notes.append(
        "The model was chosen by groups of views left out, its figure is by views left out one at "
        "a time. Every model: " + "; ".join(_trial(t) for t in answer.selection.trials) + "."
    )
    return rows, notes


def visp(seed: int) -> tuple[list[Row], list[str]]:
    """Franka arm, one AprilTag in the gripper: 8 images whose poses do not agree well."""
    recorded = load(DATA / "visp_eye_to_hand", TagGrid(1, 1, 0.048, 0.0, 10))
    result = solve_set(recorded, seed=seed)
    answer = result.calibration
    assert answer is not None
    assert answer.left_out is not None
    problem = find_start(problem_of(recorded), np.random.default_rng(seed)).problem
    deg, mm = pose_residual(answer, problem_views=len(problem.views))
    warned = any(f.code in ("inconsistent", "uncertain", "arm_noise") for f in result.findings)
    condition = "AprilTag, Franka arm, 8 images"
    rows = [
        Row(
            "visp_residual_deg",
            "rms turn between each view's tag on the gripper and their mean",
            condition,
            deg,
            "deg",
            n=_views(answer),
            paper=0.512,
            must=0.52,
        ),
        Row(
            "visp_residual_mm",
            "rms shift between each view's tag on the gripper and their mean",
            condition,
            mm,
            "mm",
            n=_views(answer),
            paper=2.35,
            must=2.4,
        ),
        Row(
            "visp_left_out_px",
            "rms distance of corners in views left out of the solve",
            condition,
            answer.left_out.px,
            "px",
            n=_views(answer),
        ),
        Row(
            "visp_sigma_mm",
            "stated error of a point 1.0-1.5 m away",
            condition,
            1e3 * answer.target_sigma(0),
            "mm",
            n=_views(answer),
            must=5.0,
            better="higher",
        ),
        Row(
            "visp_warned",
            "a warning says that the data do not agree (1: yes)",
            condition,
            float(warned),
            n=1,
            must=1.0,
            better="higher",
        ),
    ]
    return rows, [_notes("visp_eye_to_hand", answer), *(str(f) for f in result.findings)]


def pose_residual(answer: Calibration, problem_views: int) -> tuple[float, float]:
    """Scatter of the board on its mount, view by view: rms [deg], rms [mm]."""
    A = arm_for(answer.problem, 0)
    found: list[Floats] = []
    for s in answer.problem.sightings:
        poses = planar_poses(
            answer.lens(0), answer.problem.boards[s.board].points[s.corner], s.pixel
        )
        if poses is None:
            continue
        boards = inverse(A[s.view]) @ answer.camera_pose(0) @ poses.T_lens_board
        gap = np.linalg.norm(se3.logs(inverse(answer.board_pose())[None] @ boards)[:, 3:], axis=1)
        found.append(boards[int(np.argmin(gap))])
    T = np.array(found)
    twist = se3.logs(inverse(mean_pose(T))[None] @ T)
    turn = float(np.sqrt(np.mean(np.sum(twist[:, 3:] ** 2, axis=1))))
    middle = T[:, :3, 3] - T[:, :3, 3].mean(0)
    shift = float(np.sqrt(np.mean(np.sum(middle**2, axis=1))))
    assert problem_views > 0
    return float(np.rad2deg(turn)), 1e3 * shift


def _views(answer: Calibration) -> int:
    return len({s.view for s in answer.problem.sightings})


def _trial(r: Trial) -> str:
    return f"{r.name} {r.left_out.mm_all:.3f} / {r.left_out.mm:.3f} mm"


def _notes(name: str, answer: Calibration) -> str:
    p = answer.camera_pose(0)[:3, 3]
    sigma = np.sqrt(np.diagonal(answer.covariance.camera_pose(0)))
    left = (
        f"; left out: {', '.join(reason for _, reason in answer.rejected)}"
        if answer.rejected
        else ""
    )
    return (
        f"{name}: camera at x {1e3 * p[0]:.1f} y {1e3 * p[1]:.1f} z {1e3 * p[2]:.1f} mm in the "
        f"base, sigma {1e3 * sigma[:3].max():.1f} mm and "
        f"{np.rad2deg(sigma[3:].max()):.2f} deg{left}."
    )


EXPERIMENT = Experiment(
    "calibration-real",
    "Real hand-eye sets, beside the figures published with them",
    run,
    about=(
        "Two public sets: ROS-Industrial's (16 images of a ChArUco board on an ABB arm; one shows "
        "four corners only and is not used) and ViSP's (8 images of a tag in a Franka's gripper)."
    ),
)
