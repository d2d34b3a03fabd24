"""What has been seen so far, how to see more, and who is told."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration.calibrate import Calibration, CalibrationOptions, calibrate
from armsight.calibration.live.seen import (
    LookAt,
    Looked,
    MoveTo,
    Request,
    SeenView,
    problem_of,
    read_pictures,
)
from armsight.calibration.live.setup import Setup, lens_list
from armsight.calibration.live.watcher import Progress, Watcher
from armsight.calibration.solver import SolverOptions


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


@dataclass
class Log:
    """What a running procedure has: its task, what it has seen, and where the arm stands.

    Attributes:
        setup, options: the task; watcher: who is told; clock: the cell's time [s].
        views: taken so far; reasons: why boards were not found; at: (n,) where the arm rests.
    """

    setup: Setup
    options: ProcedureOptions
    watcher: Watcher
    clock: Callable[[], float]
    views: list[SeenView] = field(default_factory=list)
    reasons: set[str] = field(default_factory=set)
    at: JointVector | None = None


def go(log: Log, joints: JointVector, stage: str) -> Generator[Request, object, bool]:
    """Bring the arm somewhere, if it may stand there and go there; whether it arrived."""
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


def look(
    log: Log, stage: str, rest: float | None = None, frames: int | None = None
) -> Generator[Request, object, SeenView]:
    """Photograph with all cameras; what saw the board is kept and written down."""
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


def report(log: Log, stage: str, answer: Calibration | None = None) -> None:
    """Tell the watcher where the procedure stands."""
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


def rig_counts(log: Log) -> list[int]:
    """Views in which each camera saw the board."""
    lenses = lens_list(log.setup.cameras)
    return [
        sum(any(lenses[k].rig == rig for k, _, _ in v.found) for v in log.views)
        for rig in range(len(log.setup.cameras))
    ]


def best_views(log: Log) -> dict[int, SeenView]:
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


def solve_now(log: Log, rng: np.random.Generator) -> Calibration:
    """Solve what was seen so far: good enough to choose the next view by."""
    quick = SolverOptions(iterations=20, tolerance=1e-5)
    options = CalibrationOptions(left_out=False, solver=quick)
    return calibrate(
        problem_of(log.setup, log.views), np.random.default_rng(rng.integers(1 << 31)), options
    )
