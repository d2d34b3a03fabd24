"""One set each of ``calibration-strangers``: drawn, written to files, read and solved from them."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.boards import Board, parse_board
from armsight.calibration.export import opencv_yaml
from armsight.calibration.peers import compare
from armsight.calibration.problem import Mount, lens_from_vector
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import RecordedAnswer, solve_set
from armsight.calibration.synthetic_set import LENS, ArmErrors, SyntheticSet, make_set
from armsight.errors import ArmsightError
from armsight.experiments.calibration_layouts import PlainSet, write_corners, write_layout
from armsight.experiments.calibration_mistakes import (
    BOARD,
    MISTAKES,
    clean_set,
    findings_of,
    judge,
    write_mistake,
)
from armsight.experiments.calibration_real import DATA
from armsight.geometry.camera import PinholeCamera
from armsight.robots.robot import Robot

ARMS = ("independent errors", "wrong zeros, lengths, sag", "backlash", "lengths and backlash")
"""How the arms of clean sets err."""


@dataclass(frozen=True)
class CleanSet:
    """A set without a mistake, of an arm that errs.

    Attributes:
        drawn: it, with its truth.
        arm: one of :data:`ARMS`; size: of its errors [m].
        lens: the lens file that comes with it, its centre off by 2 px in both; None without one.
    """

    drawn: SyntheticSet
    arm: str
    size: float
    lens: PinholeCamera | None


def clean(seed: int, number: int, robot: Robot) -> CleanSet:
    """Set ``number``: all kinds of arm and both with and without a lens in turn, 8 to 40 views."""
    rng = np.random.default_rng([seed, 3, number])
    mount: Mount = "base" if rng.random() < 0.5 else "flange"
    size = float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3))))
    arm = ARMS[number // 2 % 4]
    errors = {
        ARMS[0]: ArmErrors(size, 0.0, 0.0),
        ARMS[1]: ArmErrors(1e-4, size, 0.0),
        ARMS[2]: ArmErrors(1e-4, 0.0, size),
        ARMS[3]: ArmErrors(1e-4, 0.7 * size, 0.7 * size),
    }[arm]
    drawn = make_set(robot, rng, int(rng.integers(8, 41)), mount, errors)
    c = drawn.camera
    dx, dy = rng.choice([-2.0, 2.0], 2)
    off = replace(c, cx=c.cx + float(dx), cy=c.cy + float(dy))
    return CleanSet(drawn, arm, size, off if number % 2 else None)


def clean_run(seed: int, number: int, robot: Robot) -> dict[str, Any]:
    """A clean set through the whole way: what is told, how far off it is, how sure it is."""
    one = clean(seed, number, robot)
    drawn = one.drawn
    out: dict[str, Any] = {
        "told": [], "ratio": None, "chi2": None, "error": None, "sigma": None, "arm": one.arm,
        "size": one.size, "lens": one.lens is not None, "views": drawn.views, "mount": drawn.mount,
    }  # fmt: skip
    try:
        answer = solved(drawn, one.lens)
    except ArmsightError as error:
        return out | {"told": [["refused", "error", str(error)]]}
    out["told"] = [[f.code, f.severity] for f in answer.findings]
    done = answer.calibration
    if done is None or done.selection is None:
        return out
    errors = [
        drawn.target_error(_lens(t.solution.state.lens[0]), t.solution.state.T_mount_rig[0])
        for t in done.selection.trials
    ]
    mine = drawn.target_error(done.lens(0), done.camera_pose(0))
    d = se3.logs(se3.inverses(done.camera_pose(0)[None]) @ drawn.T_mount_camera)[0]
    covariance = done.covariance.camera_pose(0)
    out["ratio"] = mine / min(errors)
    out["chi2"] = float(d @ np.linalg.solve(covariance, d))
    out["error"] = float(np.linalg.norm(d[:3]))
    out["sigma"] = float(np.sqrt(np.trace(covariance[:3, :3])))
    return out


def solved(one: SyntheticSet, lens: PinholeCamera | None) -> RecordedAnswer:
    """A set written to files and solved from them by the board alone.

    Raises:
        ArmsightError: as a stranger would be told.
    """
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        write_corners(place, plain(one))
        (place / "poses.txt").write_text(
            "\n".join(" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told) + "\n"
        )
        if lens is not None:
            (place / "lens.yaml").write_text(opencv_yaml(lens))
        return solve_set(load(place, BOARD))


def plain(one: SyntheticSet) -> PlainSet:
    """What of a set is written to files."""
    every = np.arange(len(one.points))
    size = (one.camera.width, one.camera.height)
    return PlainSet(one.told, tuple((every, p) for p in one.pixels), size)


def _lens(values: Floats) -> PinholeCamera:
    return lens_from_vector(values, LENS.width, LENS.height)


def mistake_run(seed: int, name: str, number: int, robot: Robot) -> dict[str, Any]:
    """A clean set with a mistake put in: whether it is named, and what is named wrongly."""
    rng = np.random.default_rng([seed, 2, list(MISTAKES).index(name), number])
    with tempfile.TemporaryDirectory() as place:
        folder = write_mistake(Path(place), name, clean_set(robot, rng), rng)
        named, others = judge(name, findings_of(Path(place), folder))
    return {"named": named, "wrong": sorted(others)}


def layout_run(name: str, one: SyntheticSet) -> bool:
    """Whether a set comes out of a layout as it went in: poses and mount."""
    with tempfile.TemporaryDirectory() as place:
        write_layout(Path(place), name, plain(one))
        try:
            found = load(Path(place), BOARD)
        except ArmsightError:
            return False
    if found.poses is None or found.cameras[0].mount != one.mount:
        return False
    return np.allclose(found.poses[found.cameras[0].view], one.told, atol=1e-4)


def shipped_run(name: str, words: str, seed: int) -> dict[str, Any]:
    """A recorded set as its authors ship it, solved by the board alone; peers beside it."""
    board: Board | None = parse_board(words) if words else None
    out: dict[str, Any] = {"loaded": False, "solved": False, "told": "", "views": 0}
    try:
        recorded = load(DATA / name, board)
        out["loaded"] = recorded.poses is not None
        answer = solve_set(recorded, seed=seed)
    except ArmsightError as error:
        return out | {"told": str(error)}
    out["told"] = "; ".join(f"{f.severity} {f.code}" for f in answer.findings)
    done = answer.calibration
    if done is None or any(f.severity == "error" for f in answer.findings):
        return out
    out |= {"solved": True, "views": len(done.problem.used_views)}
    if name == "rwhe_synthetic_2":  # GroundTruth.txt: the camera stands in the flange
        out["error_mm"] = 1e3 * float(np.linalg.norm(done.camera_pose(0)[:3, 3]))
    if len(done.problem.used_views) >= 8:
        peers = compare(done)
        out["peers"] = {p.name: p.mm for p in peers}
        others = [p.mm for p in peers if p.name != "armsight"]
        out["ratio"] = out["peers"]["armsight"] / min(others)
    return out
