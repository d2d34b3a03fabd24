"""Calibration without a marker: the plug, turned to the pair, is the marker."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats, JointPath, Pose, Poses
from armsight.calibration import se3
from armsight.calibration.arm import flange_poses
from armsight.calibration.robot_errors import RobotErrors
from armsight.charging.calibrate import (
    PlugCalibration,
    PlugLook,
    calibrate_by_plug,
    choose_looks,
    closed_form,
    uncalibrated,
)
from armsight.charging.plug_views import expected_noise, plug_views, tour
from armsight.charging.pose import fit_pose
from armsight.devices.camera_models import stereo_pair
from armsight.experiments.cache import RunCache
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.plug_calibration_guarded import guarded_run
from armsight.experiments.port_pictures import Album
from armsight.experiments.port_scene import LIGHTS, PortView
from armsight.experiments.rows import Row
from armsight.geometry.pose import exp, from_rpy, inverse, look_at, make_pose
from armsight.robots.catalogue import load_robot
from armsight.robots.robot import Robot
from armsight.simulation.arm_errors import true_geometry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOKS = 26
"""As many as in the paper."""
POOL = 160
SPEED, ACCELERATION = 0.5, 0.6
LOOK_SECONDS = 0.5
"""To come to rest and take both pictures."""

ABOUT = """
A UR10 with the absolute errors of the simulation (joints off by 0.05 deg, lengths by 0.5 mm), a
Type 2 plug on its flange whose place is known to 3 cm and 5 deg, a converging pair whose place is
known to 5 cm and 5 deg. 26 looks are chosen from 160 reachable ones by what they tell of the tip,
driven in the order of the shortest next way, photographed (rendered, five lights) and fitted; looks
that score below 0.7, whose roll is doubtful, or that contradict the others are dropped. The error
is that of the tip, by the calibrated arm, against where the calibrated camera says that it is, in
60 other places of the workspace; sag, and play of the plug in its holder, are not in it.
`travel_s` is travel at half speed and 0.5 s a look, from the home position, as nobody slows it.

`robot_time_s` is measured: half as many runs of `armsight calibrate ur10_charging --plug`, from
cold to the last look, in the cell with its guard and map and rendered cameras, 26 looks, the moves
chosen and made by itself; the cell's true errors are drawn by the seed. A run that fails has no
time, and counts as longer than any.
"""


@dataclass(frozen=True)
class Cell:
    """The truth of one cell and what is believed of it."""

    nominal: Robot
    robot: Robot
    T_base_camera: Pose
    T_flange_plug: Pose
    believed: PlugCalibration


def make_cell(rng: np.random.Generator) -> Cell:
    """Draw a cell."""
    nominal = load_robot("ur10")
    robot = replace(nominal, T_link_joint=true_geometry(nominal, 1.0, rng))
    eye = np.array([1.55, rng.uniform(-0.2, 0.2), rng.uniform(0.6, 0.9)])
    X = look_at(eye, [0.65, 0.0, 0.55]) @ from_rpy(rng.normal(0, 0.03, 3))
    Z = make_pose(from_rpy(rng.normal(0, 0.05, 3))[:3, :3], (0.0, 0.0, 0.20))
    Z = Z @ make_pose(None, rng.normal(0, 0.01, 3))
    guess_X = X @ exp(rng.normal(0, [0.05] * 3 + [np.deg2rad(5)] * 3))
    guess_Z = Z @ exp(rng.normal(0, [0.03] * 3 + [np.deg2rad(5)] * 3))
    believed = uncalibrated(guess_X, guess_Z, RobotErrors(nominal))
    return Cell(nominal, robot, X, Z, believed)


def views(
    cell: Cell, album: Album, count: int, rng: np.random.Generator
) -> tuple[JointPath, Poses]:
    """See :func:`plug_views`, as believed."""
    return plug_views(cell.believed, cell.nominal, album.pair, "type2_plug", count, rng)


def measure(album: Album, seed: int, run: int) -> dict[str, Any]:
    """Calibrate one cell and score it."""
    rng = np.random.default_rng((seed, run, 5))
    cell = make_cell(rng)
    joints, C = views(cell, album, POOL, rng)
    goals = joints[rng.choice(len(joints), 12, replace=False)]
    chosen = choose_looks(cell.believed, joints, C, expected_noise(C), goals, LOOKS)
    order, seconds = tour(cell.nominal, cell.nominal.home, joints[chosen], SPEED, ACCELERATION)
    seconds += LOOK_SECONDS * len(order)
    q = joints[chosen][order]
    truth = inverse(cell.T_base_camera) @ flange_poses(cell.robot, q) @ cell.T_flange_plug
    looks, dropped = [], 0
    for i, (configuration, T) in enumerate(zip(q, truth)):
        view = PortView(
            "type2_plug",
            0,
            0.0,
            0.0,
            0.0,
            0.0,
            (0.0, 0.0),
            LIGHTS[i % len(LIGHTS)],
            int(rng.integers(2**31)),
        )
        picture = album.picture(view, both=True, window=0.06, T_left_port=T)
        start = T @ exp(rng.normal(0, [1e-3, 1e-3, 3e-3, *np.deg2rad([4.0, 4.0, 4.0])]))
        T_lens_ref = (np.eye(4), inverse(album.pair.T_left_right))
        seen = fit_pose(picture.images, picture.lenses, T_lens_ref, "type2_plug", start)
        if seen.score < 0.7 or seen.doubtful:
            dropped += 1
            continue
        looks.append(PlugLook(configuration, seen.T_ref_port, seen.covariance))
    result: dict[str, Any] = {"seconds": seconds}
    test, _ = views(cell, album, 90, rng)
    test = test[:60]
    full = calibrate_by_plug(cell.nominal, looks, rng)
    result |= {"dropped": dropped + int((~full.used).sum()), "looks": len(looks)}
    plain = calibrate_by_plug(cell.nominal, looks, rng, arm=False)
    # the paper dropped its wrong looks, too
    right = [look for look, used in zip(looks, full.used) if used]
    X, Z = closed_form(cell.nominal, right)
    for name, camera, plug, theta in (
        ("", full.T_base_camera, full.T_flange_plug, full.arm_errors),
        ("ablation_rigid_", plain.T_base_camera, plain.T_flange_plug, plain.arm_errors),
        ("paper_", X, Z, np.zeros(full.errors.size)),
    ):
        mm, deg = tip_errors(cell, full.errors, test, camera, plug, theta)
        result |= {f"{name}tip": mm, f"{name}turn": deg}
    result["residual"] = float(
        np.sqrt(np.mean(np.sum(full.residual[full.used][:, :3] ** 2, axis=1)))
    )
    result["stated"] = float(np.sqrt(np.mean([full.tip_sigma(t) ** 2 for t in test[:20]])))
    return result


def tip_errors(
    cell: Cell, errors: RobotErrors, q: JointPath, X: Pose, Z: Pose, theta: Floats
) -> tuple[float, float]:
    """Root mean square of the tip's error in the workspace [m], and of its attitude [rad]."""
    truth = inverse(cell.T_base_camera) @ flange_poses(cell.robot, q) @ cell.T_flange_plug
    by_camera = X @ truth
    by_arm = errors.flange_poses(q, theta)[0] @ Z
    e = se3.logs(se3.inverses(by_camera) @ by_arm)
    return (
        float(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1)))),
        float(np.sqrt(np.mean(np.sum(e[:, 3:] ** 2, axis=1)))),
    )


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` cells."""
    album = Album(stereo_pair())
    cache = RunCache("plug-calibration", seed)
    results = []
    for i in range(runs):
        progress("cells", 0.5 * i / runs)
        results.append(cache.get(i, partial(measure, album, seed, i)))
    album.close()
    guarded = run_episodes(
        "plug-calibration",
        guarded_run,
        range(max(1, runs // 2)),
        seed,
        part_of(progress, 0.5, 0.5),
        "guarded",
    )
    rows = []
    where = f"{LOOKS} looks, {runs} cells"
    for prefix, how in (
        ("", "bundle with covariances and the arm's errors"),
        ("ablation_rigid_", "bundle, the arm believed exact"),
        ("paper_", "closed form, all looks alike"),
    ):
        tip = np.array([1e3 * r[f"{prefix}tip"] for r in results])
        turn = np.rad2deg([r[f"{prefix}turn"] for r in results])
        own = prefix == ""
        rows.append(
            Row(
                f"{prefix}tip_mm",
                f"true error of the tip, rms over cells: {how}",
                where,
                float(np.sqrt(np.mean(tip**2))),
                "mm",
                runs,
                float(tip.min()),
                float(tip.max()),
                paper=1.5 if own else None,
                must=0.8 if own else None,
                aim=0.4 if own else None,
            )
        )
        rows.append(
            Row(
                f"{prefix}tip_deg",
                f"true error of its attitude, rms over cells: {how}",
                where,
                float(np.sqrt(np.mean(turn**2))),
                "deg",
                runs,
                float(turn.min()),
                float(turn.max()),
                must=0.2 if own else None,
                aim=0.1 if own else None,
            )
        )
    seconds = [r["seconds"] for r in results]
    rows.append(
        Row(
            "travel_s",
            "travel and looks, as nobody slows them, median",
            where,
            float(np.median(seconds)),
            "s",
            runs,
            min(seconds),
            max(seconds),
        )
    )
    rows += guarded_rows(guarded)
    rows.append(
        Row(
            "dropped",
            "looks that were dropped, of 26, mean",
            where,
            float(np.mean([r["dropped"] for r in results])),
            n=runs,
            paper=3,
        )
    )
    rows.append(
        Row(
            "stated_mm",
            "the tip's error as the calibration itself states it, rms",
            where,
            1e3 * float(np.sqrt(np.mean([r["stated"] ** 2 for r in results]))),
            "mm",
            runs,
        )
    )
    notes = tuple(
        f"guarded, run {i + 1}: {r['failure'] or '; '.join(r['problems'])}"
        for i, r in enumerate(guarded)
        if r["failure"] or r["problems"]
    )
    return Outcome(tuple(rows), {"cells": lambda: _plot(results)}, notes)


def guarded_rows(guarded: list[dict[str, Any]]) -> list[Row]:
    """Time of the runs with the guard, and how far off the pair is afterwards."""
    where = f"guarded, {LOOKS} looks wanted"
    seconds = [np.inf if r["failure"] else r["seconds"] for r in guarded]
    rows = [
        Row(
            "robot_time_s",
            "from cold, moves made by itself, median",
            where,
            float(np.median(seconds)),
            "s",
            len(guarded),
            min(seconds),
            max(seconds),
            must=150,
            aim=90,
        )
    ]
    used = float(np.mean([r["used"] for r in guarded]))
    rows.append(Row("used", "looks used, mean", where, used, n=len(guarded)))
    for key, unit in (("pair_mm", "mm"), ("pair_deg", "deg")):
        what = "true error of the pair's place" if unit == "mm" else "of its attitude"
        worst = float(max(r[key] for r in guarded))
        rows.append(Row(key, f"{what}, greatest", where, worst, unit, len(guarded)))
    return rows


def _plot(results: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.5))
    axes = figure.add_subplot()
    for i, (prefix, label) in enumerate(
        (("", "bundle with the arm"), ("ablation_rigid_", "bundle"), ("paper_", "closed form"))
    ):
        values = [1e3 * r[f"{prefix}tip"] for r in results]
        axes.plot([i] * len(values), values, "o", alpha=0.6, label=label)
    axes.axhline(1.5, color="grey", lw=0.8)
    axes.set_xticks([0, 1, 2], ["bundle\nwith the arm", "bundle", "closed form"])
    axes.set_ylabel("true error of the tip [mm]")
    axes.set_ylim(0)
    return figure


EXPERIMENT = Experiment(
    "plug-calibration",
    "Calibration without a marker: the plug before the pair",
    run,
    runs=4,
    about=ABOUT,
)
