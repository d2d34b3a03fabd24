"""``servo-accuracy``: V's first experiment, and what a moving target costs: lag, gaps, switches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Vector3
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Draw, Experiment, Outcome, Progress
from armsight.experiments.servo_accuracy_rows import accuracy_rows, at_the_border, following
from armsight.experiments.servo_eyes import PAPERS, Errors, Eyes
from armsight.experiments.servo_world import (
    Setup,
    Trial,
    make_eyes,
    make_task,
    set_up,
    world_to_base,
)
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.aim import Aim, joints_for
from armsight.servoing.approach import facing
from armsight.servoing.estimate import FilterConfig, TargetFilter
from armsight.servoing.law import LawConfig
from armsight.servoing.master import PaperMaster
from armsight.servoing.sighting import Look

TICK = 0.008
NEAR = 0.015
"""An estimate this near the target has it again [m]."""
PLACES = 6
"""Of the bulls-eye, a run of :func:`pair`."""
STANDOFF = 0.05
"""How far before the surface the tip follows [m]: beyond where a permit holds it to contact
speed."""
ABOUT = f"""
V's first experiment: the ball on the stylus' tip, moved at 0.1 m/s, the joints as reference, by
the fixed cameras alone; V's mode (mean of the two closest, of what they saw last) under V's errors,
ours (one filter, a bias for each camera, predicted to now) under the cell's and under V's. V's
second, `pair_mm`: a bulls-eye at rest, 2 to 15 cm before the tip, seen by the pair alone for two
seconds; the joints that would bring the true tip to its centre, by the arm's true geometry, are the
reference, so the arm's own errors between the two poses count. Then,
ours in the guarded cell without pictures (`experiments/servo_eyes.py`): the tip follows a ball on
a circle of 0.2 m at 0.25 m/s, {1e2 * STANDOFF:.0f} cm before its surface, whole error of the tip
against where it should be; the same at the surface itself (`touching_rms_mm`), where a tip on
springs touches the ball from the side that it is at, up to 30 degrees off where it should be; the
same stand-off with 0.5 s without any picture every 2 s; and a ball that goes to and fro sideways
out of the pair's view. Ablations: without the target's velocity fed forward,
without biases.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` seeds a row."""
    parts: list[tuple[str, Callable[[int, int], Any]]] = [
        ("fixed", partial(fixed, "ours", Errors())),
        ("fixed_v_errors", partial(fixed, "ours", PAPERS)),
        ("paper_fixed", partial(fixed, "paper", PAPERS)),
        ("pair", partial(pair, "ours", Errors())),
        ("pair_v_errors", partial(pair, "ours", PAPERS)),
        ("paper_pair", partial(pair, "paper", PAPERS)),
        ("track", partial(track, {}, False, STANDOFF)),
        ("touch", partial(track, {}, False, 0.0)),
        ("track_no_feed", partial(track, {"predict": False}, False, STANDOFF)),
        ("track_no_bias", partial(track, {"biases": False}, False, STANDOFF)),
        ("gaps", partial(track, {}, True, STANDOFF)),
        ("border", partial(border, "ours")),
        ("paper_border", partial(border, "paper")),
    ]
    found: dict[str, list[Any]] = {}
    for i, (name, part) in enumerate(parts):
        cache = RunCache("servo-accuracy", seed, name)
        found[name] = []
        for k in range(runs):
            found[name].append(cache.get(k, partial(part, seed, k)))
            progress(f"{name}: {k + 1} of {runs}", (i + (k + 1) / runs) / len(parts))
    plots: dict[str, Draw] = {
        "following": partial(following, found),
        "border": partial(at_the_border, found),
    }
    return Outcome(tuple(accuracy_rows(found, runs, NEAR)), plots)


def fixed(mode: str, errors: Errors, seed: int, k: int) -> list[float]:
    """Errors of the fixed cameras at a ball on the moving tip [mm], one every 40 ms."""
    setup = set_up()
    rng = np.random.default_rng((seed, k, 1))
    eyes = make_eyes(setup, errors, rng)
    eyes.pair = None
    middle = world_to_base(setup, [[0.75, 0.0, 1.2]])[0]
    joints = _joints_on_circle(setup, middle, 0.15, 0.1)
    names = [c.name for c in eyes.fixed]
    filter_, master = TargetFilter(names), PaperMaster(wrist=False)
    last: dict[str, float] = {}
    errors_mm = []
    for step in range(round(9.0 / TICK)):
        now = step * TICK
        q = joints(now)
        eyes.expose(now, q, lambda t: tcp_pose(eyes.true_robot, joints(t))[:3, 3])
        for look in _new_looks(eyes, now, last):
            filter_.add(look)
            master.add(look)
        if step % 5 or now < 2.0:
            continue
        truth = tcp_pose(setup.robot, q)[:3, 3]
        estimate = filter_.estimate
        place = master.choose(now).position if mode == "paper" else None
        if mode == "ours" and estimate is not None:
            place = estimate.at(now)[0]
        if place is not None:
            errors_mm.append(1e3 * float(np.linalg.norm(place - truth)))
    return errors_mm


def pair(mode: str, errors: Errors, seed: int, k: int) -> list[float]:
    """Errors of the pair alone at a bulls-eye at rest [mm], one a place of :data:`PLACES`."""
    setup = set_up()
    rng = np.random.default_rng((seed, k, 4))
    eyes = make_eyes(setup, errors, rng)
    eyes.fixed.clear()
    return [_seen_by_pair(mode, setup, eyes, rng, 4.0 * i) for i in range(PLACES)]


def _seen_by_pair(
    mode: str, setup: Setup, eyes: Eyes, rng: np.random.Generator, begun: float
) -> float:
    """The last error of one place, looked at from a time [s] on [mm]; 200 where it was not seen."""
    place = world_to_base(setup, rng.uniform((0.7, -0.3, 1.1), (0.8, 0.3, 1.35))[None])[0]
    true = replace(setup, robot=eyes.true_robot)
    touching = _joints_at(true, place)
    axis = tcp_pose(eyes.true_robot, touching)[:3, 2]
    reference = tcp_pose(setup.robot, touching)[:3, 3]
    q = _joints_at(true, place - rng.uniform(0.02, 0.15) * axis)
    eyes.normal = -axis
    filter_, master = TargetFilter(["wrist"], "wrist"), PaperMaster()
    last: dict[str, float] = {}
    found = None
    for step in range(round(2.0 / TICK)):
        now = begun + step * TICK
        eyes.expose(now, q, lambda t: place)
        for look in _new_looks(eyes, now, last):
            filter_.add(look)
            master.add(look)
        if mode == "paper":
            found = master.choose(now).position
        elif filter_.estimate is not None:
            found = filter_.estimate.at(now)[0]
    return 200.0 if found is None else 1e3 * float(np.linalg.norm(found - reference))


def track(
    settings: dict[str, Any], gaps: bool, standoff: float, seed: int, k: int
) -> dict[str, Any]:
    """The tip before a ball on a circle of 0.2 m at 0.25 m/s; errors [m], times to see it again."""
    setup = set_up(1.0, 1.0)
    rng = np.random.default_rng((seed, k, 2))
    eyes = make_eyes(setup, Errors(), rng)
    if gaps:
        eyes.hidden = [("all", 3.0 + 2.0 * i, 3.5 + 2.0 * i) for i in range(4)]
    middle = world_to_base(setup, [[0.78, 0.0, 1.22]])[0]
    turn, phase = 0.25 / 0.2, float(rng.uniform(0, 2 * np.pi))

    def ball(time: float) -> Vector3:
        a = turn * time + phase
        return np.asarray(middle + 0.2 * np.array([0.0, np.sin(a), np.cos(a)]))

    chase: dict[str, Any] = {}
    if "predict" in settings:
        law = LawConfig(speed=1.0, acceleration=1.0, predict=False)
        chase["law"] = law
    if "biases" in settings:
        chase["filter"] = FilterConfig(biases=False)
    task = make_task(setup, "ours", standoff, **chase)
    start = _joints_at(setup, ball(0.0) - np.array([0.12, 0.0, 0.0]))
    trial = Trial(setup, eyes, task, ball, start, seed=k)
    course = trial.run(10.5)
    config = task.chase.config
    errors, wanted = [], []
    for now, tip in zip(course.times, course.tips):
        at = ball(now)
        flat = facing(at, config.vertical, config.front)
        axis = math.cos(config.pitch) * flat - math.sin(config.pitch) * config.vertical
        wanted.append(at - (0.04 + standoff) * axis)
        errors.append(float(np.linalg.norm(tip - wanted[-1])))
    times, wrong = np.array(course.times), np.array(course.error)
    again = [_again(times, wrong, end) for _, _, end in eyes.hidden if end < times[-1] - 0.5]
    late = times > 3.0
    squares = np.array(errors)[late] ** 2
    return {
        "rms": float(np.sqrt(squares.mean())),
        "again": again,
        "harm": course.nudges.harm,
        "switches": task.chase.switches / course.times[-1],
        "drawn": _thinned(course.times, course.tips, wanted) if k == 0 else None,
    }


def _thinned(times: Sequence[float], *courses: Sequence[Vector3]) -> list[list[float]]:
    """Rows of a time [s] and of each course's place [m], every 40 ms: what is drawn."""
    table = np.column_stack([times, *(np.asarray(course) for course in courses)])
    return [[float(v) for v in row] for row in np.round(table[::5], 5)]


def _new_looks(eyes: Eyes, now: float, last: dict[str, float]) -> Iterator[Look]:
    """What has arrived by ``now`` [s] and is not the ``last`` of its camera, which it becomes."""
    for perceived in eyes.arrived(now):
        for look in perceived.evidence.looks:  # type: ignore[attr-defined]
            if last.get(look.camera) != look.stamp:
                last[look.camera] = look.stamp
                yield look


def _again(times: Floats, wrong: Floats, end: float) -> float:
    """When the estimate has the target again after a time [s]: until then it was farther away."""
    after = (times >= end) & (times < end + 1.0)
    off = np.flatnonzero(~(wrong[after] < NEAR))
    return float(times[after][off[-1]] - end + TICK) if len(off) else 0.0


def border(mode: str, seed: int, k: int) -> dict[str, Any]:
    """A ball that goes to and fro across the pair's far border.

    Switches [1/s]; jumps [m] from round to round of the place that is servoed to, less the ball's
    own way: ``jumps`` in the round of a switch or the one after, ``others`` by any other look.
    """
    setup = set_up()
    rng = np.random.default_rng((seed, k, 3))
    eyes = make_eyes(setup, Errors() if mode == "ours" else PAPERS, rng)
    task = make_task(setup, mode)
    home = setup.robot.home
    tip = tcp_pose(setup.robot, home)
    out, side = tip[:3, 2], tip[:3, 0]

    def ball(time: float) -> Vector3:
        return np.asarray(tip[:3, 3] + 0.06 * out + 0.15 * np.sin(0.9 * time) * side)

    chase = task.chase
    seen: dict[str, float] = {}
    jumps, others = list[float](), list[float]()
    before, source, changed = None, 0.0, -math.inf
    drawn: list[list[float]] = []
    for step in range(round(10.0 / TICK)):
        now = step * TICK
        eyes.expose(now, home, ball)
        looked = False
        for look in _new_looks(eyes, now, seen):
            chase.see(look)
            looked = looked or bool(look.sightings)
        if mode == "ours":
            estimate = chase.estimate
            if estimate is None:
                continue
            place = chase.follow(now, estimate)
        else:
            choice = chase.master.choose(now)
            chase.source_number = 3.0 if choice.source.value == "pair" else 2.0
            if choice.position is None:
                continue
            place = choice.position
        if before is not None and now > 1.0:
            jump = float(np.linalg.norm(place - before - (ball(now) - ball(now - TICK))))
            if chase.source_number != source:
                jumps.append(jump)
                changed = now
            elif now < changed + 1.5 * TICK:
                jumps[-1] = max(jumps[-1], jump)
            elif looked:
                others.append(jump)
        before, source = place, chase.source_number
        if k == 0:
            off = float((place - ball(now)) @ side)
            drawn.append([now, off, float((ball(now) - ball(0.0)) @ side), source])
    return {"switches": chase.switches / 10.0, "jumps": jumps, "others": others, "drawn": drawn}


def _joints_at(setup: Setup, place: Vector3) -> JointVector:
    T = np.linalg.inv(setup.workcell.robot.T_world_base)
    up: Vector3 = np.asarray(T[:3, 2], float)
    front: Vector3 = np.asarray(T[:3, 0], float)
    flat = facing(place, up, front)
    axis = math.cos(0.5) * flat - math.sin(0.5) * up
    return joints_for(setup.robot, Aim(place, np.zeros(3), axis, -up), setup.robot.home, rounds=300)


def _joints_on_circle(
    setup: Setup, middle: Vector3, radius: float, speed: float
) -> Callable[[float], JointVector]:
    """Joints that lead the tip on a circle, by a table."""
    turn = speed / radius
    times = np.arange(0.0, 10.0, 0.04)
    rows: list[JointVector] = []
    T = np.linalg.inv(setup.workcell.robot.T_world_base)
    up: Vector3 = np.asarray(T[:3, 2], float)
    front: Vector3 = np.asarray(T[:3, 0], float)
    q = _joints_at(setup, middle + np.array([0.0, 0.0, radius]))
    for time in times:
        a = turn * time
        place = middle + radius * np.array([0.3 * np.sin(2 * a), np.sin(a), np.cos(a)])
        q = joints_for(setup.robot, Aim(place, np.zeros(3), front, -up), q, rounds=10)
        rows.append(q)
    table = np.array(rows)

    def joints(time: float) -> JointVector:
        at = min(max(time / 0.04, 0.0), len(table) - 1.001)
        i = int(at)
        return np.asarray(table[i] + (at - i) * (table[i + 1] - table[i]))

    return joints


EXPERIMENT = Experiment(
    "servo-accuracy", "Where the target is (V), and what a moving one costs", run, 20, ABOUT
)
