"""T1's five eye-to-hand experiments, T1's method and ours on the same photographs; ours from cold.

T1's method: corners in depth (median of 10 px about each), a rigid transform by RANSAC over 3D
pairs with the arm's pose; the board on the flange from the first stage. Ours: all cameras, lenses,
board and arm at once by pixels. Both get the lenses of one earlier solve, as T1 did.
"""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import arm
from armsight.calibration.boards import Detection
from armsight.calibration.calibrate import Calibration, target_points
from armsight.calibration.live.log import ProcedureOptions
from armsight.calibration.live.result import LiveResult
from armsight.calibration.live.seen import SeenView, problem_of
from armsight.calibration.model import Model
from armsight.calibration.noise import with_cut
from armsight.calibration.problem import Freedom
from armsight.calibration.solver import solve
from armsight.calibration.spheres import procrustes_ransac
from armsight.calibration.views import travel_seconds
from armsight.devices.depth_model import DepthModel
from armsight.errors import CalibrationError
from armsight.experiments.cache import RunCache
from armsight.experiments.calibration_cell import (
    CalibrationCell,
    open_calibration_cell,
    ray_points,
    true_depth_errors,
    true_lens,
    true_target_errors,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.workcell import load_workcell
from armsight.workcell.packaged import find

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER = ((82, 80, 71, 470), (44, 45, 39, 243), (14, 14, 11, 115), (9, 10, 8, 85), (5, 6, 5, 60))
"""Frames of cameras 1, 2, 3, and seconds for all three."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """Ours from cold, then the five experiments with its lenses, over ``runs`` cells."""
    cache = RunCache("calibration-eye-to-hand", seed)
    done = []
    for r in range(runs):
        progress(f"cell {seed + r}", r / runs)
        done.append(cache.get(r, lambda r=r: one(seed + r, r % 4 == 2)))  # type: ignore[misc]
    table: dict[int, list[dict[str, float]]] = {}
    for result in done:
        for k, values in result["five"].items():
            table.setdefault(int(k), []).append(values)
    cold = [result["cold"] for result in done]
    return Outcome((*_cold_rows(cold), *_five_rows(table)), {"cells": lambda: plot(cold)}, NOTES)


def one(seed: int, five: bool) -> dict[str, Any]:
    """One cell: from cold, then, if wanted, T1's experiments with its lenses."""
    cell = open_calibration_cell(load_workcell(find("ur5_calibration")), seed=seed)
    try:
        result, figures = from_cold(cell, seed)
        table: dict[int, list[dict[str, float]]] = {}
        if five:
            _five(cell, result, np.random.default_rng((seed, 5)), table)
    finally:
        cell.close()
    return {"cold": figures, "five": {str(k): values[0] for k, values in table.items()}}


NOTES = (
    "T1's experiments 3 to 5 are measured on every fourth cell. Their frames are parallel to the "
    "images, so they cannot tell where the board hangs: both methods take it, and the lenses, from "
    "an earlier stage, as T1 did (ours the arm's errors as well), and neither can be better than "
    "that stage. Lenses known before, `tre_known_lenses_mm`, are in calibration-peers.",
    "`tre_mm` is the true 3D error in the base of points given by pixel and true depth through the "
    "named lenses, over the whole image at 1.0-1.5 m, mean over three cameras.",
    "Robot time is the simulated clock: moves at 50 % speed, rests and exposures. Computing is not "
    "in it: choosing a view takes 0.15 s of a core, a solve about half a second, both possible "
    "while the arm travels.",
    "The cells differ in everything: lenses, camera places, bracket, print, arm, depth errors. "
    "The error that remains is mostly one of scale, common to all three cameras: whether print, "
    "lenses or the arm's lengths are off by 0.1 % can hardly be told apart by an A4 board.",
)


def from_cold(cell: CalibrationCell, seed: int) -> tuple[LiveResult, dict[str, float]]:
    """The whole procedure, nothing known but the sheet."""
    wall = time.process_time()
    result, seconds = cell.calibrate(ProcedureOptions(), seed)
    errors = true_target_errors(cell, result.calibration)
    depth = true_depth_errors(cell, result)
    answer = result.calibration
    of = {"infrared": [], "color": []}  # type: dict[str, list[float]]
    for name, value in errors.items():
        of[name.split()[-1]].append(value)
    return result, {
        "tre infrared": 1e3 * float(np.mean(of["infrared"])),
        "tre color": 1e3 * float(np.mean(of["color"])),
        "stated": 1e3 * float(np.mean([answer.target_sigma(k) for k in range(len(errors))])),
        "px infrared": float(np.mean([answer.solution.rms_px(k) for k in (0, 2, 4)])),
        "px color": float(np.mean([answer.solution.rms_px(k) for k in (1, 3, 5)])),
        "depth": 1e3 * float(np.nanmedian(list(depth.values()))),
        "depth worst": 1e3 * float(np.nanmax(list(depth.values()))),
        "seconds": seconds,
        "views": float(len(result.views)),
        "inside": points_inside(cell, answer),
        "compute": time.process_time() - wall,
    }


def points_inside(cell: CalibrationCell, answer: Calibration) -> float:
    """Share of points 1.0-1.5 m away whose 95 % ellipsoid holds the truth, over all lenses."""
    shares = []
    for k, lens in enumerate(answer.problem.lenses):
        pixels, z = target_points(lens.camera)
        found = [
            ray_points(camera, T, pixels, z)
            for camera, T in (
                (answer.lens(k), answer.camera_pose(lens.rig) @ answer.lens_pose(k)),
                true_lens(cell, lens.rig, lens.name),
            )
        ]
        d = found[0] - found[1]
        C = answer.covariance.points(k, pixels, z)
        q = np.einsum("ti,ti->t", d, np.linalg.solve(C, d[..., None])[..., 0])
        shares.append(float(np.mean(q < 7.815)))
    return float(np.mean(shares))


def _cold_rows(cold: list[dict[str, float]]) -> list[Row]:
    n = len(cold)

    def row(key: str, measure: str, condition: str, name: str, unit: str, **budget: Any) -> Row:
        v = np.array([c[name] for c in cold])
        return Row(
            key,
            measure,
            condition,
            float(v.mean()),
            unit,
            n=n,
            low=float(v.min()),
            high=float(v.max()),
            **budget,
        )

    condition = "ours from cold, rendered, lenses solved too"
    return [
        row(
            "tre_mm",
            "true 3D error of a point 1.0-1.5 m away",
            f"{condition}; infrared lenses",
            "tre infrared",
            "mm",
            paper=10.0,
            must=2.5,
            aim=1.2,
        ),
        row(
            "tre_mm",
            "true 3D error of a point 1.0-1.5 m away",
            f"{condition}; colour lenses",
            "tre color",
            "mm",
            paper=10.0,
            must=2.5,
            aim=1.2,
        ),
        row(
            "stated_mm", "what the calibration itself says of that error", condition, "stated", "mm"
        ),
        row(
            "reprojection_px",
            "rms distance of corners",
            f"{condition}; infrared",
            "px infrared",
            "px",
            paper=1.0,
            must=0.3,
            aim=0.15,
        ),
        row(
            "reprojection_px",
            "rms distance of corners",
            f"{condition}; colour",
            "px color",
            "px",
            paper=1.0,
            must=0.3,
            aim=0.15,
        ),
        row(
            "robot_time_s",
            "robot time from cold to the end, three cameras",
            condition,
            "seconds",
            "s",
            paper=115.0 + 128.0,
            must=150.0,
            aim=60.0,
        ),
        Row(
            "coverage_95",
            "share of points 1.0-1.5 m away whose 95 % ellipsoid holds the truth (must 88-99 %); "
            "points of one cell err alike, so the cells are what counts",
            condition,
            100 * float(np.mean([c["inside"] for c in cold])),
            "%",
            n=n,
            low=100 * float(min(c["inside"] for c in cold)),
            high=100 * float(max(c["inside"] for c in cold)),
            must=88.0,
            aim=93.0,
            better="higher",
        ),
        row("views", "board poses taken, all cameras at once", condition, "views", ""),
        row(
            "depth_error_mm",
            "true depth error after the depth model, 1-2 m over the image, median",
            condition,
            "depth",
            "mm",
            must=4.0,
            aim=2.0,
        ),
        row(
            "depth_error_mm",
            "true depth error after the depth model, 1-2 m over the image, median",
            f"{condition}; worst camera",
            "depth worst",
            "mm",
        ),
        row(
            "compute_s",
            "processor time of the whole, rendering included",
            condition,
            "compute",
            "s",
        ),
    ]


def _five(
    cell: CalibrationCell,
    result: LiveResult,
    rng: np.random.Generator,
    table: dict[int, list[dict[str, float]]],
) -> None:
    """T1's five: frames parallel to each image, spread over it, fewer and fewer."""
    answer = result.calibration
    most = (14, 14, 11)
    pools = [_pool(cell, rig, most[rig], rng) for rig in range(3)]
    for k, (*counts, _) in enumerate(PAPER, 1):
        if k < 3:
            continue  # more frames than the pool holds: experiments 3 to 5 are the useful ones
        frames = [pools[rig][: min(counts[rig], len(pools[rig]))] for rig in range(3)]
        paper = [
            _paper_method(cell, answer, result.depth[rig], frames[rig], rig, rng)
            for rig in range(3)
        ]
        ours = _our_method(cell, answer, [v for f in frames for v, _ in f])
        joints = np.array([v.joints for f in frames for v, _ in f])
        seconds = sum(
            float(travel_seconds(cell.setup.robot, a, b[None], 0.5, 0.6)[0]) + 0.3 + 5 / 15
            for a, b in pairwise(joints)
        )
        table.setdefault(k, []).append(
            {
                "paper": 1e3 * float(np.mean(paper)),
                "ours": 1e3 * ours,
                "seconds": seconds,
                "frames": float(len(joints)),
            }
        )


def _five_rows(table: dict[int, list[dict[str, float]]]) -> list[Row]:
    rows = []
    for k, values in sorted(table.items()):
        n = len(values)
        a, b, c, seconds = PAPER[k - 1]
        words = f"experiment {k}: T1 had {a}/{b}/{c} frames, board parallel to the images"
        for key, label in (("paper", "T1's method (depth corners, RANSAC)"), ("ours", "ours")):
            v = np.array([x[key] for x in values])
            rows.append(
                Row(
                    "tre_mm",
                    "true 3D error of a point 1.0-1.5 m away",
                    f"{words}, lenses of the solve from cold; {label}",
                    float(v.mean()),
                    "mm",
                    n=n,
                    low=float(v.min()),
                    high=float(v.max()),
                    paper=10.0,
                    must=2.5 if key == "ours" else None,
                    aim=1.2 if key == "ours" else None,
                )
            )
        rows.append(
            Row(
                "seconds",
                "robot time of these frames, all three cameras",
                words,
                float(np.mean([x["seconds"] for x in values])),
                "s",
                n=n,
                paper=seconds,
            )
        )
    return rows


PoolFrame = tuple[SeenView, Floats]


def _pool(cell: CalibrationCell, rig: int, count: int, rng: np.random.Generator) -> list[PoolFrame]:
    """Views with the board parallel to a camera's image, and the depth image of each."""
    lens, setup = cell.infrared(rig), cell.setup
    middle = 0.5 * (setup.board.points.max(0) + setup.board.points.min(0))
    T_base_camera = cell.T_base_camera(rig)
    out: list[PoolFrame] = []
    for _ in range(12):
        targets = []
        for _ in range(24):
            u = rng.uniform(0.15, 0.85, 2) * [lens.width, lens.height]
            ray = np.append(lens.normalise(u[None])[0], 1.0)
            T = make_pose(None, ray * rng.uniform(0.75, 1.1)) @ make_pose(None, -middle)
            targets.append(T_base_camera @ T @ inverse(setup.T_flange_board))
        q, ok = arm.reach_some(setup.robot, np.array(targets), rng, 2)
        for x in q[ok]:
            if setup.free is not None and not setup.free(x):
                continue
            cell.place(x)
            joints = cell.joints()
            photo = cell.photograph(rig)
            found = []
            for lens_index, image in ((2 * rig, photo.infrared), (2 * rig + 1, photo.color)):
                seen = setup.board.detect(image)
                if isinstance(seen, Detection):
                    found.append((lens_index, seen.corner, seen.pixel))
            if any(k == 2 * rig for k, _, _ in found):
                view = SeenView(joints, "cover", float(len(out)), tuple(found))
                out.append((view, np.asarray(photo.depth, float)))
            if len(out) >= count:
                return out
    return out


def _paper_method(
    cell: CalibrationCell,
    answer: Calibration,
    depth: DepthModel | None,
    frames: list[PoolFrame],
    rig: int,
    rng: np.random.Generator,
) -> float:
    """T1: RANSAC over 3D corner pairs; true target error [m]."""
    lens_index = 2 * rig
    lens = answer.lens(lens_index)
    board = answer.board_pose()
    camera_points, base_points = [], []
    for view, image in frames:
        corner, pixel = next((c, p) for k, c, p in view.found if k == lens_index)
        T = arm.flange_poses(cell.setup.robot, view.joints[None])[0] @ board
        X = cell.setup.board.points[corner]
        z = np.array([_median(image, p) for p in pixel])
        good = np.isfinite(z)
        if depth is not None:  # T1 corrected the depth distortion before
            z[good] = z[good] - depth.error(z[good], pixel[good], lens)
        ray = np.column_stack([lens.normalise(pixel), np.ones(len(pixel))])
        camera_points.append((ray * z[:, None])[good])
        base_points.append((X @ T[:3, :3].T + T[:3, 3])[good])
    try:
        pose, _ = procrustes_ransac(
            np.concatenate(camera_points), np.concatenate(base_points), rng, 0.01
        )
    except CalibrationError:
        return float("nan")
    return _score(cell, pose, lens, rig)


def _median(image: Floats, pixel: Floats) -> float:
    u, v = np.rint(pixel).astype(int)
    window = image[max(v - 5, 0) : v + 6, max(u - 5, 0) : u + 6]
    good = window[np.isfinite(window)]
    return float(np.median(good)) if len(good) > 5 else float("nan")


def _our_method(cell: CalibrationCell, answer: Calibration, views: list[SeenView]) -> float:
    """Ours on the same views: cameras by pixels, the rest kept from the earlier solve.

    Returns:
        Mean true target error of the three infrared lenses [m].
    """
    problem = problem_of(cell.setup, views)
    noise = answer.corner_sigma()
    seen = tuple(replace(s, sigma=noise[s.lens]) for s in problem.sightings)
    white = answer.freedom.white
    freedom = Freedom(lens=False, shape=False, robot=False, white=white)
    model = Model(replace(problem, sightings=seen), freedom)
    held = np.ones(model.size, bool)
    for rig in range(len(problem.rigs)):
        held[model.rig_slice(rig)] = False
    model.free &= ~held
    eye = np.tile(np.eye(4), (len(views), 1, 1))
    start = solve(model, replace(answer.solution.state, E=eye))
    solution = solve(model, start.state, with_cut(None))
    return float(
        np.mean(
            [
                _score(cell, solution.state.T_mount_rig[rig], answer.lens(2 * rig), rig)
                for rig in range(3)
            ]
        )
    )


def _score(cell: CalibrationCell, pose: Floats, lens: PinholeCamera, rig: int) -> float:
    """True target error of an infrared lens's pose [m]."""
    pixels, z = target_points(lens)
    true = ray_points(cell.infrared(rig), cell.T_base_camera(rig), pixels, z)
    d = ray_points(lens, pose, pixels, z) - true
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def plot(cold: list[dict[str, float]]) -> Figure:
    """True error, stated error and robot time of each cell."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    x = np.arange(len(cold))
    left.plot(x, [c["tre infrared"] for c in cold], "o", label="infrared lenses")
    left.plot(x, [c["tre color"] for c in cold], "s", label="colour lenses")
    left.plot(x, [c["stated"] for c in cold], "_", color="black", ms=12, label="stated sigma")
    left.axhline(2.5, color="grey", ls="--", lw=1, label="must, mean of cells")
    left.set(xlabel="cell", ylabel="true 3D error at 1.0-1.5 m [mm]", ylim=(0, None))
    right.bar(x, [c["seconds"] for c in cold])
    right.axhline(150, color="grey", ls="--", lw=1, label="must")
    right.axhline(60, color="grey", ls=":", lw=1, label="aim")
    right.set(xlabel="cell", ylabel="robot time from cold [s]")
    for axes in (left, right):
        axes.set_xticks(x[:: max(1, len(x) // 10)])
        axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


EXPERIMENT = Experiment(
    "calibration-eye-to-hand",
    "T1: three cameras in the base of a UR5, its method and ours",
    run,
    runs=20,
    about=(
        "T1's cell in simulation: board on a bracket of unknown offset and print error, two Kinect "
        "v2 and a Kinect v1 with lens distortion, depth distortion and noise, a UR5 with absolute "
        "errors and 0.1 mm repeatability, glare. The truth only scores."
    ),
)
