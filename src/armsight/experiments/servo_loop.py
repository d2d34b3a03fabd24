"""``servo-loop``: how soon a step of the target changes the command, and what a round costs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.experiments.servo_ball import joints_before
from armsight.experiments.servo_eyes import Errors
from armsight.experiments.servo_limits import SECONDS, beyond, bulk
from armsight.experiments.servo_world import (
    CELL,
    Setup,
    Trial,
    make_eyes,
    make_task,
    set_up,
    world_to_base,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STANDOFF = 0.10
"""The tip follows so far before the ball [m]."""
STEPS_AT, WATCHED = 1.5, 0.6
"""When the ball steps, about, and how long the answer is waited for [s]."""
STEP = (0.015, 0.04)
"""How far it steps [m]."""
CHANGED = 0.003
"""A command is another one when a joint's velocity differs by more than this [rad/s]."""
CELLS, RENDERED = 3, 6.0
"""Runs of the rendered cell, and how long each is [s]."""
RUNS, BULK = 40, 10
"""Steps; and for each of them so many runs that count limits."""

ABOUT = f"""
A ball at rest steps {1e3 * STEP[0]:.0f} to {1e3 * STEP[1]:.0f} mm sideways at a random moment, the
tip {100 * STANDOFF:.0f} cm before it, in the cell without pictures at its full speed and
acceleration. Each trial is run twice, with the step and without; the answer is the first command of
the guard that differs, counted from the exposure that first shows the step, and from the moment at
which what was seen in it arrived at the task. A step that no camera sees in time, or that is not
believed at once, counts as long as it takes.

`control_ms` is the processor time of a round of the task and of the guard (until November 2026 the
drives, the map and the cameras' model of the cell without pictures were counted, too, about a sixth
of it); `vision_ms` that of a look of all five cameras, the greatest of {CELLS} runs of
{RENDERED:g} s of the rendered ball task, which `realtime_factor` is of, too, on the machine named
(until November 2026 one run, in which kernels were compiled: 0.35). `limit_violations`
counts commands beyond the joints' declared speed or the drives' acceleration, and joints beyond
their range, in all rounds of all trials, and in {BULK} runs of {SECONDS:g} s a step beside them:
ball, bulls-eye, straw and hand in turn, without pictures or contact, the targets wandering at up to
0.4 m/s, jumping every 0.4 to 3 s by up to a quarter of a metre a way or to anywhere, out of reach,
out of the map and into the arm, and three times hidden from all cameras.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` steps; before these the rendered cell."""
    setup = set_up(1.0, 1.0)
    cells = []
    for k in range(CELLS + 1):
        progress(f"rendered cell {k} of {CELLS}", 0.05 * k / CELLS)
        cells.append(rendered(seed + k))
    cells = cells[1:]  # in the first the simulation's kernels may still have to be compiled
    cache = RunCache("servo-loop", seed)
    steps = []
    for k in range(runs):
        steps.append(cache.get(k, lambda k=k: one(setup, (seed, k))))  # type: ignore[misc]
        progress(f"step {k + 1} of {runs}", 0.05 + 0.25 * (k + 1) / runs)
    counted = bulk(BULK * runs, seed, lambda say, share: progress(say, 0.3 + 0.6 * share))
    rows = _rows(steps, counted, cells)
    notes = (*_notes(steps), _counted(counted))
    return Outcome(tuple(rows), {"times": partial(_times, steps)}, notes)


def one(setup: Setup, seed: tuple[int, int]) -> dict[str, Any]:
    """One step of the target, with its twin without; times [ms]."""
    still, moved = (_commands(setup, seed, with_step) for with_step in (False, True))
    rng = np.random.default_rng((*seed, 23))
    begins = _begins(rng)
    differ = np.abs(moved["commands"] - still["commands"]).max(axis=1) > CHANGED
    answered = np.flatnonzero(differ & (moved["times"] >= begins))
    told = moved["times"][answered[0]] if len(answered) else math.inf
    shown = min((s for s, _ in moved["looks"] if s >= begins), default=math.inf)
    arrived = min((a for s, a in moved["looks"] if s >= begins), default=math.inf)
    answers = math.isfinite(told) and math.isfinite(shown)
    return {
        "exposure_ms": 1e3 * (told - shown) if answers else None,
        "reaction_ms": 1e3 * (told - arrived) if answers else None,
        "control_ms": moved["control"],
        "violations": moved["violations"],
        "rounds": len(moved["times"]),
    }


def _begins(rng: np.random.Generator) -> float:
    """When the step happens [s]: anywhere between two pictures."""
    return STEPS_AT + float(rng.uniform(0.0, 0.2))


def _commands(setup: Setup, seed: tuple[int, int], with_step: bool) -> dict[str, Any]:
    """The guard's commands of one trial, what arrived when, and what rounds cost."""
    rng = np.random.default_rng((*seed, 23))
    begins = _begins(rng)
    place = world_to_base(setup, [list(rng.uniform((0.72, -0.25, 1.10), (0.90, 0.25, 1.30)))])[0]
    way = rng.normal(0.0, 1.0, 3) * np.array([0.0, 1.0, 1.0])
    way *= rng.uniform(*STEP) / np.linalg.norm(way)

    def ball(now: float) -> Vector3:
        return np.asarray(place + way if with_step and now >= begins else place)

    eyes = make_eyes(setup, Errors(), np.random.default_rng((*seed, 29)))
    task = make_task(setup, "ours", STANDOFF)
    trial = Trial(setup, eyes, task, ball, joints_before(setup, place), seed=seed[1])
    looks: list[tuple[float, float]] = []
    known: set[tuple[str, float]] = set()
    costs, joints, arrivals = list[float](), [], eyes.arrived
    round_ms = [0.0]

    def timed(work: Callable[..., Any]) -> Callable[..., Any]:
        def step(*args: Any) -> Any:
            before = time.thread_time()
            done = work(*args)
            round_ms[0] += 1e3 * (time.thread_time() - before)
            return done

        return step

    task.update = timed(task.update)
    trial.cell.guard.step = timed(trial.cell.guard.step)  # type: ignore[method-assign]

    def arrived(now: float) -> Any:
        found = arrivals(now)
        for perceived in found:
            for look in perceived.evidence.looks:  # type: ignore[attr-defined]
                if look.sightings and (look.camera, look.stamp) not in known:
                    known.add((look.camera, look.stamp))
                    looks.append((look.stamp, now))
        return found

    eyes.arrived = arrived  # type: ignore[method-assign]
    while trial.now < begins + WATCHED:
        round_ms[0] = 0.0
        trial.step()
        costs.append(round_ms[0])
        joints.append(trial.cell.q.copy())
    commands = np.array(trial.course.commands)
    stops = np.array(trial.cell.commands)[:, -1] > 0.0
    return {
        "times": np.array(trial.course.times),
        "commands": commands,
        "looks": looks,
        "control": costs[50:],  # the first rounds compile
        "violations": beyond(setup.robot.limits, setup.guard, commands, stops, np.array(joints))[
            "violations"
        ],
    }


class _Timed:
    """A perceiver, and the processor time of each of its looks [ms]."""

    def __init__(self, eye: Any) -> None:
        self._eye, self.costs = eye, list[float]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._eye, name)

    def update(self, frames: Sequence[Any]) -> Any:
        """See :class:`~armsight.motion.perception.Perceiver`."""
        before = time.thread_time()
        found = self._eye.update(frames)
        self.costs.append(1e3 * (time.thread_time() - before))
        return found


def rendered(seed: int) -> dict[str, float]:
    """Vision's cost [ms] and simulated seconds a second of the rendered ball task."""
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.tasks.servo import ServoOptions
    from armsight.workcell import open_cell
    from armsight.workcell.packaged import load

    with open_cell(load(CELL), seed) as cell:
        task = ServoOptions().make(cell)
        eyes = [_Timed(eye) for eye in task.perceivers]
        task.perceivers = tuple(eyes)  # type: ignore[arg-type]
        session = Session(cell, task, seed=seed, mode=SessionMode(cell_is_empty=True))
        session.warm_up(lambda stage, done: None)
        session.run(RENDERED)
        looks = [np.percentile(eye.costs[2:], 99.0) for eye in eyes if len(eye.costs) > 2]
        return {
            "vision": float(np.sum(looks)),
            "looks": float(sum(len(eye.costs) for eye in eyes)),
            "factor": float(session.realtime_factor),
        }


def _rows(
    steps: list[dict[str, Any]], counted: list[dict[str, Any]], cells: list[dict[str, float]]
) -> list[Row]:
    where = "ours, speed 1, acceleration 1"
    answered = [s for s in steps if s["reaction_ms"] is not None]
    rounds = sum(s["rounds"] for s in steps) + sum(c["ticks"] for c in counted)
    beyond_any = sum(one["violations"] for one in (*steps, *counted))
    control = np.concatenate([s["control_ms"] for s in steps])
    factors = [cell["factor"] for cell in cells]

    def p99(values: Any) -> float:
        return float(np.percentile(values, 99.0)) if len(values) else math.nan

    return [
        Row("reaction_ms", "frame arrived to changed command, 99th percentile", where,
            p99([s["reaction_ms"] for s in answered]), "ms", len(answered), must=60.0, aim=30.0,
            why="no step was answered"),
        Row("exposure_to_command_ms", "exposure to changed command, 99th percentile", where,
            p99([s["exposure_ms"] for s in answered]), "ms", len(answered), must=100.0, aim=75.0,
            why="no step was answered"),
        Row("control_ms", "processor time of a round of task and guard, 99th percentile", where,
            p99(control), "ms", len(control), must=6.0, aim=4.0),
        Row("vision_ms", "processor time of a look of all five cameras, 99th percentiles added",
            "rendered", max(cell["vision"] for cell in cells), "ms",
            int(sum(cell["looks"] for cell in cells)), must=35.0, aim=25.0),
        Row("limit_violations", "rounds beyond a limit of position, speed or acceleration", where,
            float(beyond_any), n=rounds, must=0.0, aim=0.0),
        Row("realtime_factor", "simulated seconds a second, ball task, median; least and greatest",
            "rendered", float(np.median(factors)), "", len(factors), min(factors), max(factors),
            must=0.4, aim=0.8, better="higher"),
    ]  # fmt: skip


def _counted(counted: list[dict[str, Any]]) -> str:
    """What the runs that count limits were."""
    by = {
        name: sum(c["ticks"] for c in counted if c["task"] == name)
        for name in dict.fromkeys(c["task"] for c in counted)
    }
    kinds = {k: sum(c[k] for c in counted) for k in ("position", "speed", "acceleration")}
    return (
        f"Limits were counted in {len(counted)} runs of {SECONDS:g} s with "
        f"{sum(c['jumps'] for c in counted)} jumps ({sum(c['stops'] for c in counted)} ticks of "
        f"braking): {', '.join(f'{name} {ticks} ticks' for name, ticks in by.items())}; beyond "
        f"{', '.join(f'{kind} {n}' for kind, n in kinds.items())}."
    )


def _notes(steps: list[dict[str, Any]]) -> tuple[str, ...]:
    missed = sum(s["reaction_ms"] is None for s in steps)
    return (f"Steps without an answer within {WATCHED:g} s: {missed} of {len(steps)}.",)


def _times(steps: list[dict[str, Any]]) -> Figure:
    """What share of steps is answered by when, and of rounds is done by when."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    answers, rounds = figure.subplots(1, 2)
    for key, label, must in (
        ("reaction_ms", "since the picture arrived", 60.0),
        ("exposure_ms", "since it was exposed", 100.0),
    ):
        values = np.sort([s[key] for s in steps if s[key] is not None])
        share = np.arange(1, len(values) + 1) / len(steps)
        (line,) = answers.step(values, share, where="post", label=label)
        answers.axvline(must, color=line.get_color(), lw=0.8, ls=":")
    costs = np.sort(np.concatenate([s["control_ms"] for s in steps]))
    rounds.plot(costs, 1.0 - np.arange(len(costs)) / len(costs))
    rounds.axvline(6.0, color="0.6", lw=0.8, ls=":")
    answers.set(xlabel="[ms]", ylabel="share of steps answered", ylim=(0.0, 1.02))
    answers.legend(fontsize=7)
    rounds.set(xlabel="a round of task and guard takes [ms]", ylabel="share that takes longer",
               yscale="log")  # fmt: skip
    return figure


EXPERIMENT = Experiment(
    "servo-loop", "How soon a step of the target changes the command, and what it costs", run,
    RUNS, ABOUT,
)  # fmt: skip
