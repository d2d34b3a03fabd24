"""``servo-straw``: V's fourth experiment, a straw to the mouth of a face that moves."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.experiments.episodes import part_of
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.experiments.servo_ball import path_of
from armsight.experiments.servo_cell import PushedCell, plate
from armsight.experiments.servo_eyes import PAPERS, Errors
from armsight.experiments.servo_onlooker import COMES, begun, posed, said_empty, watched
from armsight.experiments.servo_rendered import SHARE, Trials, agreement
from armsight.experiments.servo_rows import harm_row, median_row, share_row
from armsight.experiments.servo_sip import FACE, Sip
from armsight.experiments.servo_trials import (
    FREE,
    Drawn,
    gap_row,
    run_plan,
    run_trials,
    tick,
    told_of,
    unguarded,
)
from armsight.experiments.servo_world import Setup, make_eyes, make_task, set_up
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import from_rpy, inverse
from armsight.motion.collision import CollisionModel
from armsight.motion.kernels import body_centers, self_clearance
from armsight.servoing.aim import Aim, joints_for
from armsight.simulation.targets import MOUTH, TargetSpec, target_object
from armsight.tasks.servo import ServoOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CELL = "ur10_straw"
LIMIT = 15.0
"""A trial is given up after this [s]."""
MOUTH_SIZE = 0.015
"""A straw that touches the face this near the mouth's middle is in the mouth [m]."""
FASTEST = 0.2
"""Of the mouth [m/s]."""
PLACES = ((0.80, 0.0, 1.20), (0.75, 0.25, 1.10), (0.75, -0.25, 1.30), (0.85, 0.1, 1.30))
PITCHES = np.deg2rad((0.0, 15.0, 30.0, 45.0, -15.0))
"""How far below the horizontal the tool may point at a start [rad]; the first at which the wrist
does not lie against the forearm is taken."""
RUNS = 24

ABOUT = f"""
V's fourth experiment: 24 combinations of four places of the face and of the tip's six starts. The
face is a box of 24 x 24 x 12 cm and 4.4 kg held by a neck of 3 N/mm, at rest in a third of the
trials, else on seeded smooth paths with a greatest speed of up to {FASTEST:g} m/s, turned by up to
15 deg. Success: the straw's first touch of the face lies within {1e3 * MOUTH_SIZE:.0f} mm of the
mouth's middle, within {LIMIT:g} s, and never presses harder than the permit. The straw bends with
0.15 N/mm (assumption), in series with the face's surface.

Contact, force sensor, drives and arm are the simulated world's, in steps of 1 ms; the arm's
absolute errors are off there, so the tip is where the joints say. What the cameras say is drawn
from a model (`experiments/servo_eyes.py`); V's modes run under V's errors, without permits' soft
contact being part of V: they ask for the same permit as ours. `ablation_unguarded_paper_` is V's
hybrid mode for an arm without a guard, as V's was: harm counts there what a face does not stand.

`rendered_`: one in {SHARE} of the trials of ours, with the same face, path and start, in the whole
cell: rendered pictures of all five cameras and what is found in them, its own map, the arm's and
cameras' true errors. The face is not there when it is said that nobody is in the cell
(`--cell-is-empty`): it appears {COMES:g} s before the task begins, which the time is counted from.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` trials of ours, half as many of V's modes."""
    v, half = replace(PAPERS, arm=0.0), max(runs // 2, 1)
    plan = [
        ("", "ours", Errors(arm=0.0), runs),
        ("paper_", "paper", v, half),
        ("fixed_", "fixed", v, half),
        (FREE, "paper unguarded", v, half),
    ]
    told = part_of(progress, 0.0, 0.6)
    results = run_plan("servo-straw", CELL, plan, one, seed, told)
    count, trial = max(runs // SHARE, 1), partial(one_rendered, set_up(1.0, 1.0, CELL))
    told = told_of("rendered", progress, 0.6, 0.4)
    shown = run_trials("servo-straw", ["rendered"], trial, count, seed, told)
    rows = [*_rows(results), *_rendered_rows(results[""], shown)]
    notes = (*_notes(results), *_notes({"rendered": shown}))
    return Outcome(tuple(rows), {"touches": lambda: _plot(results)}, notes)


def one(setup: Setup, mode: str, errors: Errors, seed: tuple[int, int]) -> dict[str, Any]:
    """One trial; what it came to, as JSON values."""
    mode, _, free = mode.partition(" ")
    drawn = _drawn(setup, errors, seed)
    T, T_world_mouth = drawn.T, drawn.T_world_target
    region, soft = BODY_REGIONS["face"], setup.guard.soft
    item = replace(
        target_object(TargetSpec(FACE, "smiley", T_world_mouth)),
        mass=region.mass, surface=1.0 / (1.0 / soft + 1.0 / region.stiffness), hold=3e3,
        max_speed=10.0,
    )  # fmt: skip
    middle = T[:3, :3] @ np.array([-MOUTH[0], -MOUTH[1], -0.06])
    cell = PushedCell(
        setup, plate((0.24, 0.24), 0.12, T[:3, :3], middle), drawn.path, drawn.start, item,
        np.asarray(inverse(item.solid.T_frame_solid) @ T_world_mouth), seed=seed[1],
    )  # fmt: skip
    try:
        task, sip, status = make_task(setup, mode, dock="straw"), Sip(T[:3, 2], not free), None
        while cell.now < LIMIT and not sip.over:
            status = (unguarded if free else tick)(cell, drawn.eyes, task, status)
            sip.look(cell, status.permit)
        return {
            **sip.found(),
            "speed": drawn.speed,
            "iterations": int(task.chase.iterations),
            "last": cell.log[-1].reason if cell.log else "",
            "permit": "" if status is None else str(status.permit or ""),
        }
    finally:
        cell.close()


def one_rendered(setup: Setup, seed: tuple[int, int]) -> dict[str, Any]:
    """The same face in the rendered cell; what it came to, as JSON values."""
    drawn = _drawn(setup, Errors(arm=0.0), seed)
    target = {"mass_kg": BODY_REGIONS["face"].mass, **posed(drawn.T_world_target)}
    cell = begun(setup, target, drawn.start)
    judge, found = watched(
        cell, setup, ServoOptions("straw"), drawn.path, lambda task: Sip(drawn.T[:3, 2]),
        1000 * seed[0] + seed[1], LIMIT, said_empty,
    )  # fmt: skip
    return {**judge.found(), "speed": drawn.speed, "iterations": 0, **found}


def _drawn(setup: Setup, errors: Errors, seed: tuple[int, int]) -> Drawn:
    rng = np.random.default_rng((*seed, 13))
    k = seed[1]
    base = setup.workcell.robot.T_world_base
    turn = rng.uniform(-0.25, 0.25, 3)
    where = np.array(PLACES[k % 4]) + rng.uniform(-0.03, 0.03, 3)
    upright = from_rpy((0.5 * np.pi, 0.0, -0.5 * np.pi))
    T_world_mouth = np.asarray(from_rpy(turn, where) @ upright)
    T = np.asarray(inverse(base) @ T_world_mouth)
    speed = 0.0 if k % 3 == 0 else float(rng.uniform(0.1, FASTEST))
    path = path_of(T[:3, 3], speed, rng)
    eyes = make_eyes(setup, errors, rng)
    eyes.normal, eyes.marked = T[:3, 2], False
    return Drawn(T, T_world_mouth, path, speed, eyes, _start(setup, T, k // 4 % 6))


def good(trial: dict[str, Any]) -> bool:
    """Whether the straw came into the mouth, and gently."""
    return bool(trial["touched"] and trial["mm"] <= 1e3 * MOUTH_SIZE and not trial["harm"])


def _start(setup: Setup, T: Pose, which: int) -> JointVector:
    """(n,) joints of one of six starts, the tip 25 to 35 cm from the mouth, level if it can be."""
    to_base = np.asarray(inverse(setup.workcell.robot.T_world_base))
    up, front = to_base[:3, 2], to_base[:3, 0]
    side = np.cross(up, front)
    ways = (0.0 * up, 0.12 * up, -0.08 * up, 0.2 * side, -0.2 * side, 0.1 * up + 0.15 * side)
    at = T[:3, 3] - 0.25 * front + ways[which]
    model = CollisionModel(setup.robot)
    for pitch in PITCHES:
        axis = math.cos(pitch) * front - math.sin(pitch) * up
        q = joints_for(setup.robot, Aim(at, np.zeros(3), axis, -up), setup.robot.home, rounds=300)
        body_centers(model.body, np.asarray(q, float), model.scratch().centers)
        if self_clearance(model.body, model.scratch().centers) > 0.0:
            return q
    raise ValueError(f"the arm cannot stand at start {which} of a face at {T[:3, 3].round(2)}")


def _where(prefix: str) -> str:
    """The condition of a row."""
    words = {
        "": "ours, speed 1, acceleration 1",
        "fixed_": "V's errors, fixed cameras",
        FREE: "V's errors, V's hybrid without the guard",
    }
    return words.get(prefix, "V's errors")


def _rows(results: dict[str, list[dict[str, Any]]]) -> list[Row]:
    rows: list[Row] = []
    say = f"share of trials in which the straw first touched within {1e3 * MOUTH_SIZE:.0f} mm"
    for prefix, found in results.items():
        ours, where = prefix == "", _where(prefix)
        done = [r for r in found if good(r)]
        rows += [
            share_row(f"{prefix}straw_success", say, where, [good(r) for r in found],
                      None if prefix == "fixed_" else 0.67,
                      (0.90, 0.95) if ours else None),
            median_row(f"{prefix}straw_time_s", "time to the touch, of the successes", where,
                       [r["seconds"] for r in done], "s", None if prefix == "fixed_" else 8.7,
                       (6.0, 5.0) if ours else None),
            median_row(f"{prefix}straw_force_n", "peak force, of all touches", where,
                       [r["force"] for r in found if r["touched"]], "N", None,
                       (5.0, 2.0) if ours else None),
        ]  # fmt: skip
    for prefix, figure in (("paper_", 6.0), ("fixed_", None), (FREE, 6.0)):
        steps = [float(r["iterations"]) for r in results[prefix] if good(r)]
        where = _where(prefix)
        rows.append(median_row(f"{prefix}straw_iterations", "segments", where, steps, "", figure))
    rows.append(gap_row([good(r) for r in results["paper_"]], 0.67))
    free = float(np.mean([good(r) for r in results[FREE]]))
    rows.append(
        Row(f"{FREE}gap", "the same share of an arm without the guard, less V's figure, absolute",
            _where(FREE), abs(free - 0.67), n=len(results[FREE]))
    )  # fmt: skip
    say = "trials pressed above the permit or the face's limit, or elsewhere than the face"
    for prefix, found in results.items():
        harm = sum(r["harm"] for r in found)
        if prefix == "":
            rows.append(harm_row(say, "ours", harm, len(found)))
        else:
            rows.append(Row(f"{prefix}harm", say, _where(prefix), float(harm), n=len(found)))
    return rows


def _rendered_rows(bulk: list[dict[str, Any]], shown: list[dict[str, Any]]) -> list[Row]:
    say = f"the straw first touched within {1e3 * MOUTH_SIZE:.0f} mm"
    where = "ours, speed 1, acceleration 1"
    harm = [r["harm"] for r in shown]
    return agreement("straw", say, where, _came_to(shown), _came_to(bulk), harm)


def _came_to(found: list[dict[str, Any]]) -> Trials:
    return Trials([good(r) for r in found], [r["seconds"] for r in found if good(r)])


def _notes(results: dict[str, list[dict[str, Any]]]) -> tuple[str, ...]:
    notes = []
    for key, found in results.items():
        bad = [r for r in found if not good(r)]
        words = "; ".join(
            f"{r['mm']:.0f} mm off" if r["touched"] else (r["permit"] or r["last"] or "no reason")
            for r in bad[:6]
        )
        if bad:
            notes.append(f"Failed, {key or 'ours'}: {len(bad)} of {len(found)}: {words}.")
    return tuple(notes)


def _plot(results: dict[str, list[dict[str, Any]]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    where, how_hard = figure.subplots(1, 2)
    names = {"": "ours", "paper_": "V's hybrid", "fixed_": "V's, fixed", FREE: "V's, no guard"}
    for prefix, found in results.items():
        done = [r for r in found if r["touched"]]
        label = f"{names[prefix]}: {len(done)} of {len(found)} touched"
        where.plot([r["seconds"] for r in done], [r["mm"] for r in done], "o", ms=4, label=label)
        how_hard.plot([r["seconds"] for r in done], [r["force"] for r in done], "o", ms=4)
    where.axhline(1e3 * MOUTH_SIZE, color="0.6", lw=0.8)
    where.set(xlabel="touched after [s]", ylabel="from the mouth's middle [mm]")
    where.legend(fontsize=7)
    how_hard.axhline(5.0, color="0.6", lw=0.8)
    how_hard.set(xlabel="touched after [s]", ylabel="peak force [N]", yscale="log")
    return figure


EXPERIMENT = Experiment(
    "servo-straw", "A straw to a mouth that moves (V): ours beside V's mode", run, RUNS, ABOUT
)
