"""``servo-handover``: V's fifth experiment, an item let go above a palm that moves."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import JointVector, Points, Pose
from armsight.errors import UsageError
from armsight.experiments.episodes import part_of
from armsight.experiments.forecast_clips import find_clips
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.recorded_hands import PLAYS, recorded_path
from armsight.experiments.rows import Row
from armsight.experiments.servo_apart import KEPT, apart, first_apart
from armsight.experiments.servo_ball import path_of
from armsight.experiments.servo_cell import PushedCell, plate
from armsight.experiments.servo_eyes import PAPERS, Errors, Path
from armsight.experiments.servo_landing import Delivery, Landing
from armsight.experiments.servo_onlooker import COMES, EMPTY, begun, posed, said_empty, watched
from armsight.experiments.servo_rendered import SHARE, Trials, agreement
from armsight.experiments.servo_rows import harm_row, median_row, share_row
from armsight.experiments.servo_trials import Drawn, gap_row, run_plan, run_trials, tick, told_of
from armsight.experiments.servo_world import Setup, make_eyes, make_task, set_up
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import from_rpy, inverse
from armsight.motion.permits import LIMITS
from armsight.servoing.aim import Aim, joints_for
from armsight.simulation.targets import TargetSpec, target_object
from armsight.tasks.servo import ServoOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CELL = "ur10_handover"
LIMIT = 15.0
"""A trial is given up after this [s]."""
LANDS = 0.03
"""The item stays on a palm of 95 x 85 mm when its middle lands this near the palm's [m]."""
FASTEST = 0.2
"""Of the palm [m/s]."""
COVERED = 0.5
"""Share of the pair's pictures in which the held item hides the disc, near the palm."""
BOX = ((0.75, 0.0, 1.09), (0.20, 0.50, 0.10))
"""Centre and edges of where V's 12 places of the hand are drawn from, in this cell's world [m]."""
HEIGHTS = (0.22, 0.30, 0.38)
"""Before a recorded hand the arm begins so far above where that comes to rest [m], or at home:
where it is apart from where the hand begins."""
DRAWS = 200
"""As many recordings are looked at for one that leads through neither bench nor arm."""
RUNS = 24

ABOUT = f"""
V's fifth experiment: the hand at 12 places, the item held by the gripper from the start (V fetches
it from a fixed place first). The palm is at rest in a third of the trials; in a third it moves on
seeded smooth paths with a greatest speed of up to {FASTEST:g} m/s; in a third as a recorded hand
does for {PLAYS:g} s, until that slows down and rests at one of V's places (until November 2026 its
mean lay there, and it rested up to 0.6 m off, in places that the cell does not map or the arm does
not reach), never through the bench (one in five came up out of it) or through the arm where that
begins (one in four did; somebody who sees an arm stand there does not); before those the arm
begins {KEPT:g} m or more from where the hand begins, if there is such a place. The palm is tilted
by up to 10 deg. The item falls from where the gripper lets it go, with the gripper's velocity;
success: its middle lands within {1e3 * LANDS:.0f} mm of the palm's, within {LIMIT:g} s, without
harm. In {100 * COVERED:.0f} % of the pair's pictures from nearer than 0.35 m the item hides the
disc.

Recorded hands pick, place and hand over at up to 3 m/s as if no arm were there. A force counts, and
is harm beyond what is permitted, when it grows while a permit holds, or where the arm moves faster
than 5 cm/s at the touching point, as in all experiments; but not while the hand is faster than a
hand may be that is touched ({LIMITS["hand"].region_speed:g} m/s), and than what it runs into.
`handover_struck_n` is what is left: hands that run into an arm that stands there, or is slower than
they are. (Until November 2026 a force counted while any part of the arm moved, and the page had
16 N of a hand that ran into an upper arm that drew back at 2.7 cm/s.)

Contact of the gripper with the hand (ISO/TS 15066's mass and surface, held by 0.5 N/mm), the force
sensor, drives and arm are the simulated world's, in steps of 1 ms; the arm's absolute errors are
off there. What the cameras say is drawn from a model (`experiments/servo_eyes.py`); V's modes run
under V's errors.

`rendered_`: one in {SHARE} of the trials of ours, with the same palm, path and start, in the whole
cell: rendered pictures of all five cameras and what is found in them, its own map, the arm's and
cameras' true errors. The hand is not there when it is said that nobody is in the cell
(`--cell-is-empty`): it appears {COMES:g} s before the task begins, which the time is counted from.
It has nobody behind it, in the other trials neither. `fetched_`: the same palms with all of V's
task there: the arm begins at home and takes the item, a loose thing, from the bench, and then the
hand appears; success is that the item itself comes down within {1e3 * LANDS:.0f} mm of the palm's
middle. (Nothing lies on a simulated hand: it falls on through.)
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` trials of ours, half as many of each of V's modes.

    Raises:
        ArmsightError: the recordings are not there.
    """
    find_clips()
    v_errors = replace(PAPERS, arm=0.0)
    plan = [
        ("", "ours", Errors(arm=0.0), runs),
        ("paper_", "paper", v_errors, max(runs // 2, 1)),
        ("fixed_", "fixed", v_errors, max(runs // 2, 1)),
    ]
    told = part_of(progress, 0.0, 0.6)
    results = run_plan("servo-handover", CELL, plan, one, seed, told)
    shown, fetched = _rendered(runs, seed, part_of(progress, 0.6, 0.4))
    rows = [*_rows(results), *_rendered_rows(results[""], shown, fetched)]
    notes = (*_notes(results), *_notes({"rendered": shown, "fetched": fetched}))
    return Outcome(tuple(rows), {"ways": partial(_ways, results)}, notes)


def one(setup: Setup, mode: str, errors: Errors, seed: tuple[int, int]) -> dict[str, Any]:
    """One trial; what it came to, as JSON values."""
    drawn = _drawn(setup, errors, seed)
    T, path = drawn.T, drawn.path
    region = BODY_REGIONS["hand"]
    item = replace(
        target_object(TargetSpec("hand", "hand", drawn.T_world_target)),
        mass=region.mass, surface=region.stiffness, hold=500.0, max_speed=10.0,
    )  # fmt: skip
    cell = PushedCell(
        setup, _hand(T), path, drawn.start, item,
        np.asarray(inverse(item.solid.T_frame_solid) @ drawn.T_world_target), seed=seed[1],
    )  # fmt: skip
    try:
        task = make_task(setup, mode, dock="hand")
        landing, status = Landing(task), None
        while cell.now < LIMIT:
            status = tick(cell, drawn.eyes, task, status)
            landing.look(cell, status.permit)
            if landing.over:
                break
        return {
            **landing.found(),
            "speed": drawn.speed,
            "clip": drawn.clip,
            "way": landing.way if seed[1] < 6 else None,
            "last": cell.log[-1].reason,
            "permit": "" if status is None else str(status.permit or ""),
        }
    finally:
        cell.close()


def one_rendered(setup: Setup, fetch: bool, seed: tuple[int, int]) -> dict[str, Any]:
    """The same hand in the rendered cell; what it came to, as JSON values.

    Without ``fetch`` the arm begins where it does in the other trial, and the item falls as there.
    With it the arm begins at home and fetches the item, which lies on the bench, is held by the
    fingers' friction, and falls.
    """
    drawn = _drawn(setup, Errors(arm=0.0), seed)
    start = setup.robot.home if fetch else drawn.start
    cell = begun(
        setup, {"mass_kg": BODY_REGIONS["hand"].mass, **posed(drawn.T_world_target)}, start
    )
    options = ServoOptions("hand", fetch=fetch)
    make, wanted = (Delivery, _has_item) if fetch else (Landing, said_empty)
    judge, found = watched(
        cell, setup, options, drawn.path, make, 1000 * seed[0] + seed[1], LIMIT, wanted, not fetch
    )
    return {**judge.found(), "speed": drawn.speed, "clip": drawn.clip, "way": None, **found}


def _has_item(task: Any, now: float) -> bool:
    return now > EMPTY and bool(task.fetch.done)


def _drawn(setup: Setup, errors: Errors, seed: tuple[int, int]) -> Drawn:
    rng = np.random.default_rng((*seed, 17))
    k = seed[1]
    base = setup.workcell.robot.T_world_base
    where = np.array(BOX[0]) + rng.uniform(-0.5, 0.5, 3) * BOX[1]
    turn = np.array([*rng.uniform(-0.17, 0.17, 2), np.pi + rng.uniform(-0.5, 0.5)])
    T_world_palm = np.asarray(from_rpy(turn, where))
    T = np.asarray(inverse(base) @ T_world_palm)
    start = _start(setup, T, k % 3)
    if k % 3 == 2:
        path, clip, speed, start = _recorded_past(setup, T, start, rng)
    else:
        speed, clip = 0.0 if k % 3 == 0 else float(rng.uniform(0.1, FASTEST)), ""
        path = path_of(T[:3, 3], speed, rng)
    eyes = make_eyes(setup, replace(errors, hidden_near=COVERED), rng)
    eyes.normal, eyes.along, eyes.marked = T[:3, 2], -T[:3, 0], False
    return Drawn(T, T_world_palm, path, speed, eyes, start, clip)


def _recorded_past(
    setup: Setup, T: Pose, start: JointVector, rng: np.random.Generator
) -> tuple[Path, str, float, JointVector]:
    """A recorded hand's path through neither bench nor arm, its clip, greatest speed, and a start.

    Raises:
        UsageError: there is none among the recordings.
    """
    base, hand, home = setup.workcell.robot.T_world_base, _hand(T), setup.robot.home
    lower = setup.workcell.mapping.lower
    assert lower is not None
    bench = lower[2]  # to within a voxel
    ways = [_start(setup, T, way, height) for height in HEIGHTS for way in range(3)]
    for _ in range(DRAWS):
        path, clip, speed = recorded_path(T[:3, 3], base, rng, rests=True)
        times = np.arange(0.0, LIMIT, 0.05)
        way = np.array([path(time) for time in times])
        lowest = float((way @ base[2, :3]).min() + (hand @ base[2, :3]).min()) + base[2, 3]
        if lowest <= bench:
            continue
        swept = (hand[None] + way[times < PLAYS, None]).reshape(-1, 3)
        free = [q for q in (start, *ways, home) if apart(setup.robot, q, swept) > 0.0]
        if free:
            return path, clip, speed, first_apart(setup.robot, free, hand + path(0.0))
    raise UsageError(
        f"no recorded hand stays above the bench at {bench:g} m, and beside the arm; "
        "check the recordings"
    )


def _hand(T: Pose) -> Points:
    """(k, 3) points of the hand and forearm, less the palm's place, axes of ``base`` [m]."""
    R = T[:3, :3]
    palm = plate((0.095, 0.085), 0.028, R, R @ np.array([0.0, 0.0, -0.014]))
    fingers = plate((0.076, 0.084), 0.018, R, R @ np.array([0.085, 0.0, -0.014]))
    forearm = plate((0.22, 0.062), 0.045, R, R @ np.array([-0.157, 0.0, -0.014]))
    return np.concatenate([palm, fingers, forearm])


def _start(setup: Setup, T: Pose, which: int, height: float = 0.22) -> JointVector:
    """(n,) joints with the gripper pointing down, beside the palm and so far above it [m]."""
    to_base = np.asarray(inverse(setup.workcell.robot.T_world_base))
    up, front = to_base[:3, 2], to_base[:3, 0]
    side = np.cross(up, front)
    ways = (-0.15 * front, 0.2 * side, -0.2 * side)
    at = T[:3, 3] + height * up + ways[which]
    aim = Aim(at, np.zeros(3), -up, -front)
    return joints_for(setup.robot, aim, setup.robot.home, rounds=300)


def _good(trial: dict[str, Any]) -> bool:
    return bool(trial["mm"] is not None and trial["mm"] <= 1e3 * LANDS and not trial["harm"])


def _rows(results: dict[str, list[dict[str, Any]]]) -> list[Row]:
    rows: list[Row] = []
    say = (
        f"share of trials in which the item landed within {1e3 * LANDS:.0f} mm of the palm's middle"
    )
    for prefix, paper in (("", 0.75), ("paper_", 0.75), ("fixed_", 0.58)):
        found, ours = results[prefix], prefix == ""
        where = "ours, speed 1, acceleration 1" if ours else "V's errors"
        done = [r for r in found if _good(r)]
        rows += [
            share_row(f"{prefix}handover_success", say, where, [_good(r) for r in found], paper,
                      (0.85, 0.90) if ours else None),
            median_row(f"{prefix}handover_time_s", "time to letting go, of the successes", where,
                       [r["seconds"] for r in done], "s", None, (6.0, 4.9) if ours else None),
        ]  # fmt: skip
    for say_which, which in (("at rest", 0), ("smooth paths", 1), ("recorded hands", 2)):
        found = results[""][which::3]
        times = [r["seconds"] for r in found if _good(r)]
        rows += [
            share_row("handover_success_of", say, say_which, [_good(r) for r in found], None),
            median_row("handover_time_s_of", "time to letting go, of the successes", say_which,
                       times, "s"),
        ]  # fmt: skip
    forces = [r["force"] for r in results[""]]
    rows.append(
        Row("handover_force_n", "greatest force of the arm on the hand, of all trials", "ours",
            max(forces), "N", len(forces), must=10.0, aim=5.0)
    )  # fmt: skip
    rows.append(
        Row("handover_struck_n", "greatest force of a hand that ran into an arm that stood",
            "ours", max(r["struck"] for r in results[""]), "N", len(forces))
    )  # fmt: skip
    rows.append(gap_row([_good(r) for r in results["paper_"]], 0.75))
    harm = sum(r["harm"] for r in results[""])
    rows.append(harm_row("trials pressed above the permit", "ours", harm, len(results[""])))
    return rows


def _rendered(
    runs: int, seed: int, progress: Progress
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The first tenth of our trials in the rendered cell, without and with fetching."""
    found, count = [], max(runs // SHARE, 1)
    for k, fetch in enumerate((False, True)):
        trial = partial(one_rendered, set_up(1.0, 1.0, CELL), fetch)
        name = "fetched" if fetch else "rendered"
        told = told_of(name, progress, 0.5 * k, 0.5)
        found.append(run_trials("servo-handover", [name], trial, count, seed, told))
    return found[0], found[1]


def _came_to(found: list[dict[str, Any]]) -> Trials:
    return Trials([_good(r) for r in found], [r["seconds"] for r in found if _good(r)])


def _rendered_rows(
    bulk: list[dict[str, Any]], shown: list[dict[str, Any]], fetched: list[dict[str, Any]]
) -> list[Row]:
    say = f"the item landed within {1e3 * LANDS:.0f} mm of the palm's middle"
    where = "ours, speed 1, acceleration 1"
    harm = [r["harm"] for r in shown]
    lies = f"the fetched item itself came down within {1e3 * LANDS:.0f} mm of the palm's middle"
    whole = _came_to(fetched)
    return [
        *agreement("handover", say, where, _came_to(shown), _came_to(bulk), harm),
        share_row("fetched_handover_success", f"share of rendered trials in which {lies}",
                  "ours, fetching the item", whole.good, 0.75),
        median_row("fetched_handover_time_s", "time to letting go, of the successes",
                   "ours, fetching the item", whole.seconds, "s"),
        harm_row("rendered trials that pressed above the permit", "ours, fetching the item",
                 sum(r["harm"] for r in fetched), len(fetched)),
    ]  # fmt: skip


def _notes(results: dict[str, list[dict[str, Any]]]) -> tuple[str, ...]:
    notes = []
    for key, found in results.items():
        bad = [r for r in found if not _good(r)]
        words = "; ".join(_why(r) for r in bad[:6])
        if bad:
            notes.append(f"Failed, {key or 'ours'}: {len(bad)} of {len(found)}: {words}.")
    ours = results.get("", [])
    struck = [f"{r['struck']:.0f} N ({r['clip']})" for r in ours if r["struck"] > 0.0]
    if struck:
        notes.append(
            f"In {len(struck)} of {len(ours)} trials of ours a hand ran into the arm while "
            f"that stood: {', '.join(struck)}."
        )
    return tuple(notes)


def _why(trial: dict[str, Any]) -> str:
    """Why a trial failed."""
    clip = trial["clip"] and f", {trial['clip']}"
    if trial["harm"]:
        return f"pressed with {trial['force']:.0f} N{clip}"
    if trial["mm"] is not None:
        return f"{trial['mm']:.0f} mm off"
    return f"{trial['phase']}: {trial['permit'] or trial['last']}{clip}"


def _ways(results: dict[str, list[dict[str, Any]]]) -> Figure:
    """Ways to the palm of the first six of ours, and where items land, by mode."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    ways, lands = figure.subplots(1, 2)
    kinds = ("at rest", "moving", "as recorded")
    for k, trial in enumerate(results[""][:6]):
        table = 1e2 * np.array(trial["way"])
        ways.plot(table[:, 1], table[:, 2], color=f"C{k % 3}", lw=0.9,
                  label=kinds[k] if k < 3 else None)  # fmt: skip
    for prefix, label in (("", "ours"), ("paper_", "V's hybrid"), ("fixed_", "V's, fixed")):
        found = results[prefix]
        values = np.sort([r["mm"] for r in found if r["mm"] is not None])
        share = np.arange(1, len(values) + 1) / len(found)
        lands.step(values, share, where="post", label=f"{label}, {len(found)}")
    lands.axvline(1e3 * LANDS, color="0.6", lw=0.8, ls=":")
    ways.set(xlabel="beside the palm [cm]", ylabel="above it [cm]")
    lands.set(xlabel="lands from the palm's middle [mm]", ylabel="share of all", xlim=(0.0, 120.0),
              ylim=(0.0, 1.02))  # fmt: skip
    ways.legend(fontsize=7)
    lands.legend(fontsize=7)
    return figure


EXPERIMENT = Experiment(
    "servo-handover",
    "An item to a palm that moves (V): ours beside V's two modes",
    run,
    RUNS,
    ABOUT,
)
