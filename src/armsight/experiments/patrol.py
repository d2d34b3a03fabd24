"""``patrol``: T2's A-B-A with a reactive robot, with ours, and with nothing in the way."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.episodes import Watch, packaged_cell, run_episodes, with_simulation
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, bootstrap, contact_row
from armsight.motion.data import PlanRequest
from armsight.motion.plan import Plan, Planner
from armsight.motion.risk import PaperRisk
from armsight.motion.separation import Separation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armsight.mapping.snapshot import WorkspaceSnapshot
    from armsight.motion.guard_config import GuardConfig
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask

ROUNDS = 5
"""A-B-A in a row in one run, the map's memory kept from one to the next."""
LIMIT = 40.0
"""A round that takes longer is broken off and counts as this long [s]."""
GOALS = {
    "A": np.deg2rad([-78.0, -58.0, 82.0, -114.0, -90.0, 0.0]),
    "B": np.deg2rad([58.0, -58.0, 82.0, -114.0, -90.0, 0.0]),
}
"""Arm outstretched: the direct way is an arc of 0.7 m with room behind it [rad]."""
OBSTACLE, SIZE = "obstacle", (0.10, 0.10, 0.20)
"""T2's obstacle: 10 x 20 cm [m]."""
SPEED = 0.5
"""Of the obstacle [m/s]."""
AWAY, IN = np.array([1.7, 0.0, 1.1]), np.array([0.76, 0.0, 1.1])
"""Where it waits, and where it blocks the direct way, in world [m]."""
SPREAD = np.array([0.03, 0.12, 0.05])
"""It comes to within this much of there [m]."""
GAP, STAY = (3.0, 8.0), (1.0, 3.0)
"""Seconds between two visits, and how long one lasts, drawn uniformly."""
START = 10.0
"""Time for the way to A before the first round [s]."""
BEFORE = 30.0
"""Visits begin this long before the first picture, so that their phase is random [s]."""
NEVER = 1e6
"""A decay of danger so fast that nothing is remembered [1/s]."""

Method = Literal["reactive", "ours"]
Scene = Literal["static", "moving", "free"]
CONDITIONS: dict[str, tuple[Method, Scene]] = {
    "1 reactive, static": ("reactive", "static"),
    "2 reactive, moving": ("reactive", "moving"),
    "3 ours, moving": ("ours", "moving"),
    "4 ours, static": ("ours", "static"),
    "direct, free": ("ours", "free"),
    "direct, nobody inside": ("ours", "free"),
}
NOBODY_INSIDE = ("4 ours, static", "direct, nobody inside")
"""Somebody has said so, so what stands there is a thing, and nobody hides in unseen space."""
PAPER: dict[str, tuple[float, float, float]] = {
    "1 reactive, static": (0.0183, 0.0178, 10.61),
    "2 reactive, moving": (0.0217, 0.0130, 26.67),
    "3 ours, moving": (0.0141, 0.0129, 8.30),
    "direct, free": (0.0145, 0.0006, 4.99),
}
"""T2, table II: planning, optimisation, execution [s]."""
BUDGET = {"3 ours, moving": (1.25, 1.1), "4 ours, static": (1.15, 1.05)}
"""Most that a round may take over the direct one: must, aim."""

ABOUT = """
A-B-A in the packaged cell `ur5_four_cameras` without people, the arm outstretched. The obstacle
(10 x 20 cm) comes into the direct way between A and B at 0.5 m/s, stays for 1 to 3 s, leaves and
comes again 3 to 8 s later, drawn from the seed: in a run it does the same for every method. It
gives way to nobody. Execution is the time from leaving A to being back, planning and waiting
included; no rest at the goals. A run is five rounds in a row, the map's memory kept; the way to A
before the first one is not counted.

* **reactive**: T2's baseline. The same planner without memory of danger; the arm keeps 2 cm and
  room to stop from what it sees, halts when its path is blocked, and plans anew. It would not stop
  for a person in time.
* **ours**: danger-aware paths, separation, reflex. It takes the obstacle for a person's hand, so it
  keeps the protective distance; the paper's robot did not. While it stays the nearer goal is about
  0.42 to 0.53 m from it, and S_p of an arm that stands is 0.48 m: mostly the arm waits until it has
  left, whatever way it could plan. Where it stands from the start, somebody has said that nobody is
  in the cell, and it is a thing; the direct rounds beside it have that word, too.
"""


class Obstacle:
    """Moves the obstacle of the simulated cell along its timetable; an observer of the session."""

    name = "obstacle"
    period = 0.02

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        self._scene = scene
        self._visits = _timetable(rng)
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """Called by the session that is watched."""
        self._session = session

    def update(self, now: float) -> None:
        """Send it where it should be."""
        assert self._session is not None
        if self._scene != "free" and self._session.cell.world is not None:
            self._session.cell.world.drag(OBSTACLE, self.target(now))

    def target(self, now: float) -> Vector3:
        """(3,) where it belongs at a time [m]."""
        if self._scene == "static":
            return self._visits[0][2]
        for begin, end, place in self._visits:
            way = float(np.linalg.norm(place - AWAY)) / SPEED
            if begin <= now < end + way:
                share = min((now - begin) / way, 1.0) - max((now - end) / way, 0.0)
                return np.asarray(AWAY + share * (place - AWAY))
        return AWAY


def _timetable(rng: np.random.Generator) -> list[tuple[float, float, Vector3]]:
    """Begin, end and place of each visit, until the time limit is long over."""
    visits, now = [], -BEFORE
    while now < START + ROUNDS * LIMIT:
        now += float(rng.uniform(*GAP))
        place = IN + rng.uniform(-SPREAD, SPREAD)
        way = float(np.linalg.norm(AWAY - place)) / SPEED
        end = now + way + float(rng.uniform(*STAY))
        visits.append((now, end, place))
        now = end + way
    return visits


class Counted:
    """A planner that remembers how long its good answers took."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.forget()

    def forget(self) -> None:
        """Whatever came before does not count."""
        self.planning: list[float] = []
        self.optimisation: list[float] = []
        self.planned: list[float] = []

    def plan(
        self,
        request: PlanRequest,
        snapshot: WorkspaceSnapshot,
        time_limit: float,
        rng: np.random.Generator,
    ) -> Plan:
        """See :class:`~armsight.motion.plan.Planner`."""
        plan = self._planner.plan(request, snapshot, time_limit, rng)
        if plan.good:
            self.planning.append(plan.planning_s)
            self.optimisation.append(plan.optimisation_s)
        if plan.trajectory is not None:
            self.planned.append(plan.trajectory.duration)
        return plan


class Rounds:
    """Ends the session when all rounds are done, or when one takes too long."""

    name = "rounds"
    period = 0.02

    def __init__(self, task: PatrolTask) -> None:
        self._task = task
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """Called by the session that is watched."""
        self._session = session

    def update(self, now: float) -> None:
        """Look how far the patrol is."""
        assert self._session is not None
        times = self._task.times
        began = times[2 * ((len(times) - 1) // 2)] if times else START - LIMIT
        if len(times) > 2 * ROUNDS:
            self._session.stop("rounds done")
        elif now - began > LIMIT:
            self._session.stop("too long")

    def executions(self) -> list[float]:
        """Seconds of each round; one that was broken off counts as the limit."""
        times = self._task.times[::2]
        done = [after - before for before, after in pairwise(times)]
        return done if len(done) == ROUNDS else [*done, LIMIT]


def reactive(config: GuardConfig) -> GuardConfig:
    """T2's baseline: 2 cm and room to stop, no person assumed anywhere, no reflex."""
    return replace(
        config,
        separation=Separation(person_speed=0.0, intrusion=0.0, person_error=0.01, arm_error=0.01),
        reflex_distance=0.0,
        risk=PaperRisk(threshold=math.inf),
    )


def episode(seed: int, run: int) -> dict[str, Any]:
    """Five times A-B-A under one condition; module-level, for worker processes."""
    from armsight.motion.collision import CollisionModel
    from armsight.motion.keep_out import SeparationPlanner
    from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
    from armsight.runtime.config import SessionConfig, SessionMode
    from armsight.runtime.configure import guard_config
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world
    from armsight.workcell.schema_things import ObjectSection

    condition = list(CONDITIONS)[run % len(CONDITIONS)]
    method, scene = CONDITIONS[condition]
    # The same seed for all conditions of a run: the same obstacle at the same times.
    rng = np.random.default_rng((seed, run // len(CONDITIONS)))
    obstacle = Obstacle(scene, rng)
    x, y, z = (float(c) for c in obstacle.target(0.0))
    box = ObjectSection(name=OBSTACLE, kind="box", size=SIZE, position=(x, y, z))
    objects = () if scene == "free" else (box,)
    workcell = with_simulation(packaged_cell(), person=(), object=objects)
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        timing = SessionConfig()
        guard = guard_config(workcell, timing)
        speed, acceleration = guard.planned
        settings = PlannerConfig(speed=speed, acceleration=acceleration)
        if method == "reactive":
            guard = reactive(guard)
            settings = replace(settings, alpha=NEVER)
        planner: Planner = RrtConnectPlanner(cell.robot, CollisionModel(cell.robot), settings)
        if method == "ours":
            infos = [camera.info for camera in cell.cameras]
            planner = SeparationPlanner(planner, cell.robot, infos, guard)
        counted = Counted(planner)
        task = PatrolTask(GOALS, dwell=0.0)
        watch, rounds = Watch(), Rounds(task)
        session = Session(
            cell,
            task,
            seed=run,
            mode=SessionMode(cell_is_empty=condition in NOBODY_INSIDE),
            config=replace(timing, guard=guard, planner=counted),
            observers=(watch, obstacle, rounds),
        )
        session.warm_up()  # the first plan on a machine takes seconds: it is compiled
        counted.forget()
        session.run(START + ROUNDS * LIMIT)
        touched = simulated_world(cell).truth.moving_contacts
        return {
            "condition": condition,
            "executions": rounds.executions(),
            "planned": counted.planned,
            "planning": counted.planning,
            "optimisation": counted.optimisation,
            "contacts": len(touched),
            "reflexes": watch.log[-1].reflexes if watch.log else 0,
            "replans": watch.log[-1].replans if watch.log else 0,
        }


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` runs of five rounds under each condition."""
    numbers = range(runs * len(CONDITIONS))
    results = run_episodes("patrol", episode, numbers, seed, progress)
    by = {name: [r for r in results if r["condition"] == name] for name in CONDITIONS}
    unfinished = {name: sum(t >= LIMIT for t in executions(mine)) for name, mine in by.items()}
    notes = [
        f"{name}: {count} of {len(executions(by[name]))} rounds were broken off after "
        f"{LIMIT:.0f} s and count as that."
        for name, count in unfinished.items()
        if count
    ]
    legs = [t for r in by["direct, free"] for t in r["planned"][1:]]
    notes.append(
        f"The direct motions alone, at the planned speed, would take {2.0 * np.mean(legs):.2f} s "
        "for A-B-A; the rest of the direct time is planning and slowing for unseen space."
    )
    rows = _rows(by, np.random.default_rng((seed, 1)))
    return Outcome(tuple(rows), {"execution": lambda: _plot(by)}, tuple(notes))


def executions(results: list[dict[str, Any]]) -> list[float]:
    """Seconds of all rounds of these runs."""
    return [t for r in results for t in r["executions"]]


def _rows(by: dict[str, list[dict[str, Any]]], rng: np.random.Generator) -> list[Row]:
    rows = []
    direct = {name: float(np.mean(executions(by[name]))) for name in by if "direct" in name}
    for name, mine in by.items():
        figures = {
            "planning_s": [s for r in mine for s in r["planning"]],
            "optimisation_s": [s for r in mine for s in r["optimisation"]],
            "execution_s": executions(mine),
        }
        for (key, values), paper in zip(figures.items(), PAPER.get(name, (None,) * 3)):
            low, high = bootstrap(values, rng)
            mean = float(np.mean(values)) if values else math.nan
            rows.append(
                Row(
                    key,
                    f"{key.split('_')[0]} time of A-B-A, mean",
                    name,
                    mean,
                    "s",
                    n=len(values),
                    low=None if math.isnan(low) else low,
                    high=None if math.isnan(high) else high,
                    paper=paper,
                )
            )
        if name not in direct:
            base = direct[NOBODY_INSIDE[1] if name in NOBODY_INSIDE else "direct, free"]
            times = executions(mine)
            must, aim = BUDGET.get(name, (None, None))
            # Rounds of one run are not independent: runs are drawn, not rounds.
            means = [float(np.mean(r["executions"])) / base for r in mine]
            low, high = bootstrap(means, rng)
            rows.append(
                Row(
                    "patrol_ratio",
                    "execution over the direct one, means",
                    name,
                    float(np.mean(times)) / base,
                    n=len(times),
                    low=None if math.isnan(low) else low,
                    high=None if math.isnan(high) else high,
                    paper=PAPER[name][2] / PAPER["direct, free"][2] if name in PAPER else None,
                    must=must,
                    aim=aim,
                )
            )
            contacts = sum(r["contacts"] for r in mine)
            budget = None if must is None else 0.0
            rows.append(contact_row(contacts, "anything", name, len(times), budget))
            rows.append(
                Row(
                    "reflexes",
                    "reflexes started",
                    name,
                    float(sum(r["reflexes"] for r in mine)),
                    n=len(times),
                    paper=2.0 if name.startswith("3") else None,
                )
            )
    return rows


def _plot(by: dict[str, list[dict[str, Any]]]) -> Figure:
    """Execution times, ours and the paper's means."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.5))
    axes = figure.subplots()
    axes.boxplot([executions(mine) for mine in by.values()])
    ticks = list(range(1, len(by) + 1))
    paper = [PAPER[name][2] if name in PAPER else math.nan for name in by]
    axes.plot(ticks, paper, "D", color="tab:red", label="T2, mean")
    axes.set_xticks(ticks, list(by))
    axes.set(ylabel="A-B-A [s]", ylim=(0, None))
    axes.legend()
    return figure


EXPERIMENT = Experiment(
    name="patrol",
    title="T2's A-B-A: reactive, ours, direct",
    run=run,
    runs=20,
    about=ABOUT,
)
