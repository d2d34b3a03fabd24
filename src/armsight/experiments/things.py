"""``things``: what stands beside the arm's way, and what a person leaves there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.episodes import Watch, packaged_cell, run_episodes, with_simulation
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armsight.devices.world import World
    from armsight.runtime.session import Session
    from armsight.workcell import Workcell
    from armsight.workcell.schema_things import SolidSection

SECONDS = 40.0
"""Length of a run beside a thing [s]."""
BEGIN = 3.0
"""Goals count from here on [s]: until then it is looked whether the cell is at rest."""
KINDS = ("nothing", "box", "bottle", "stool", "drum")
TABLE = 0.75
"""Height of the cell's table in world [m]."""
GAP = (0.05, 0.40)
"""Between the thing and the parts of the arm on its straight way from A to B [m]."""
PARCEL = 0.12
"""Edge of what a person brings [m]."""
REACHED = 0.12
"""The palm's middle is that close when the finger tips are at a place [m]."""
LEFT_SECONDS = 17.0

ABOUT = """
The packaged cell `ur5_four_cameras` with all its sensor errors, and nobody in it when it starts,
which it is told (`--cell-is-empty`). Six runs belong together: the same seed with nothing, a box
(20 cm), a bottle (8 x 28 cm), a stool (30 cm wide, 45 cm high) and a cable drum (30 x 25 cm) on the
table, 5 to 40 cm from the parts of the arm on its straight way from A to B, and a box without the
word (`undeclared_goals_share`). The goals of the last 37 s count.

In a second kind of run somebody walks in, puts a parcel of 12 cm on the table, and walks out again;
`left_s` is the time from when the hand is 10 cm away from it until the map takes it for a thing.
"""


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run beside a thing; module-level, so that worker processes can import it."""
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    group, member = divmod(run, len(KINDS) + 1)
    said = member < len(KINDS)
    kind = KINDS[member] if said else "box"
    rng = np.random.default_rng((seed, group))
    workcell = with_simulation(packaged_cell(), person=(), object=())
    place = _place(workcell, rng, kind)
    workcell = with_simulation(workcell, undeclared=() if place is None else _solids(kind, place))
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        watch = Watch()
        mode = SessionMode(cell_is_empty=said)
        Session(cell, task, seed=group, observers=(watch,), mode=mode).run(SECONDS)
        return {
            "kind": kind if said else "unsaid",
            "place": None if place is None else [round(float(v), 3) for v in place],
            "goals": sum(t > BEGIN for t in task.times),
            "contacts": len(simulated_world(cell).truth.moving_contacts),
        }


def _place(workcell: Workcell, rng: np.random.Generator, kind: str) -> Floats | None:
    """(2,) where on the table the thing stands, in world [m]."""
    from armsight.robots.kinematics import path_sphere_centers
    from armsight.workcell import robot_in

    if kind == "nothing":
        return None
    robot = robot_in(workcell)
    a, b = list(workcell.goals.values())[:2]
    path = a + np.linspace(0.0, 1.0, 60)[:, None] * (b - a)
    T = workcell.robot.T_world_base
    centers = path_sphere_centers(robot, path).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
    spheres = robot.spheres
    assert spheres is not None
    radius = np.tile(spheres.radius, len(path))
    for _ in range(1000):
        place = np.array([rng.uniform(-0.2, 0.95), rng.uniform(-0.6, 0.6)])
        solids = [section.solid for section in _solids(kind, place)]
        gap = min(float((solid.distance(centers) - radius).min()) for solid in solids)
        if GAP[0] <= gap <= GAP[1] and np.linalg.norm(place) > 0.3:
            return place
    raise RuntimeError(f"no room for a {kind} beside the way")


def _solids(kind: str, place: Floats) -> tuple[SolidSection, ...]:
    """What the cell is not told of: a thing on the table."""
    from armsight.workcell.schema_things import SolidSection

    x, y = (float(v) for v in place)
    if kind == "box":
        return (SolidSection(name="box", size=(0.2, 0.2, 0.2), position=(x, y, TABLE + 0.1)),)
    if kind == "bottle":
        at = (x, y, TABLE + 0.14)
        return (
            SolidSection(name="bottle", kind="cylinder", radius=0.04, height=0.28, position=at),
        )
    if kind == "drum":
        at = (x, y, TABLE + 0.125)
        return (SolidSection(name="drum", kind="cylinder", radius=0.15, height=0.25, position=at),)
    seat = SolidSection(name="seat", size=(0.3, 0.3, 0.03), position=(x, y, TABLE + 0.435))
    legs = tuple(
        SolidSection(
            name=f"leg{i}{j}",
            kind="cylinder",
            radius=0.015,
            height=0.42,
            position=(x + 0.13 * i, y + 0.13 * j, TABLE + 0.21),
        )
        for i in (-1, 1)
        for j in (-1, 1)
    )
    return (seat, *legs)


class Carried:
    """Leads a parcel along in somebody's right hand, and leaves it where the hand stops.

    This is the scenery: it moves what the simulation lets one move, and tells nobody.

    Attributes:
        away: when the hand was 10 cm from what it had left [s]; taken: when the map took it for a
            thing [s]; infinite before.
    """

    name = "carried"
    period = 0.02

    def __init__(self, target: Floats) -> None:
        self._target = target
        self._session: Session | None = None
        self._put = False
        self.away = self.taken = math.inf

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """Carry, or look."""
        assert self._session is not None
        world = self._session.cell.world
        assert world is not None
        hand = _hand_of(world)
        if not self._put:
            self._put = bool(np.linalg.norm(hand - self._target) < REACHED)
            world.drag("parcel", self._target if self._put else hand)
            return
        if math.isinf(self.away):
            # The parcel's half edge, the hand's length, and 10 cm between them.
            if np.linalg.norm(hand - self._target) > PARCEL / 2 + 0.1 + 0.1:
                self.away = now
            return
        snapshot = self._session.snapshot()
        if math.isinf(self.taken) and snapshot is not None and len(snapshot.things):
            T = self._session.cell.T_world_base
            things = snapshot.things @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32)
            if (np.abs(things - self._target).max(axis=1) < PARCEL).sum() >= 20:
                self.taken = now


def _hand_of(world: World) -> Floats:
    """Where the visitor's right hand is drawn, in world [m]."""
    parts = {m.name: m.T_world_solid[:3, 3] for m in world.movers()}
    return np.asarray(parts["visitor/right_hand/palm/1"])


def left(seed: int, run: int) -> dict[str, Any]:
    """Somebody brings a parcel and goes; module-level, as :func:`episode`."""
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world
    from armsight.workcell.schema_things import ObjectSection, PersonSection

    rng = np.random.default_rng((seed, 10_000 + run))
    y = float(rng.uniform(-0.35, 0.35))
    start, distance = np.array([3.2, y]), 1.75
    target = np.array([0.95, y, TABLE + PARCEL / 2 + 0.005])
    ahead = start[0] - distance - target[0]
    person = PersonSection(
        name="visitor",
        script="walk_in",
        position=(float(start[0]), float(start[1]), 0.0),
        yaw_deg=180.0,
        period_s=12.0,
        start_s=3.0,
        distance=distance,
        target=(ahead, 0.0, float(target[2])),
    )
    parcel = ObjectSection(
        name="parcel", size=(PARCEL,) * 3, position=(float(start[0]), y + 0.2, 1.0), path="free"
    )
    workcell = with_simulation(packaged_cell(), person=(person,), object=(parcel,))
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        carried = Carried(target)
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        mode = SessionMode(cell_is_empty=True)
        Session(cell, task, seed=run, observers=(carried,), mode=mode).run(LEFT_SECONDS)
        return {
            "seconds": carried.taken - carried.away,
            "put": math.isfinite(carried.away),
            "contacts": len(simulated_world(cell).truth.moving_contacts),
        }


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` groups: one with each kind of thing, and somebody who leaves a parcel."""
    members = len(KINDS) + 1
    beside = run_episodes("things", episode, range(runs * members), seed, progress)
    brought = run_episodes("things-left", left, range(runs), seed, progress)
    goals = {
        kind: np.array([e["goals"] for e in beside if e["kind"] == kind], float)
        for kind in (*KINDS, "unsaid")
    }
    rows = [_share("box_goals_share", "all kinds", np.stack([goals[k] for k in KINDS[1:]]), goals)]
    rows += [_share(f"{k}_goals_share", k, goals[k], goals, must=None) for k in KINDS[1:]]
    rows.append(_share("undeclared_goals_share", "a box, no word", goals["unsaid"], goals, None))
    contacts = sum(e["contacts"] for e in (*beside, *brought))
    trials = len(beside) + len(brought)
    seconds = [e["seconds"] for e in brought]
    rows += [
        Row(
            "left_s",
            "until what a person left is taken for a thing, median",
            f"{sum(map(math.isfinite, seconds))} of {len(seconds)} were",
            float(np.median(seconds)),
            "s",
            n=len(seconds),
            must=3.0,
            aim=1.0,
            why="no parcel was taken for a thing",
        ),
        Row(
            "things_contacts",
            "contacts of the moving arm with anything, runs with one",
            "beside things, and while somebody leaves one",
            contacts,
            n=trials,
            low=trials * wilson(min(contacts, trials), trials)[0],
            high=trials * wilson(min(contacts, trials), trials)[1],
            must=0.0,
            aim=0.0,
        ),
    ]
    return Outcome(tuple(rows), {"goals": lambda: _plot(goals)})


def _share(
    key: str, condition: str, with_thing: Floats, goals: dict[str, Floats], must: float | None = 0.8
) -> Row:
    """Goals beside a thing over the same cell's without, and the spread over groups."""
    shares = (with_thing / np.maximum(goals["nothing"], 1.0)).reshape(-1)
    return Row(
        key,
        "goals a minute beside a thing over an empty cell's, mean",
        condition,
        float(shares.mean()),
        n=len(shares),
        low=float(shares.min()),
        high=float(shares.max()),
        must=must,
        aim=None if must is None else 0.95,
        better="higher",
    )


def _plot(goals: dict[str, Floats]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3))
    axes = figure.subplots()
    for i, counts in enumerate(goals.values()):
        axes.plot(np.full(len(counts), i), 60.0 / (SECONDS - BEGIN) * counts, "o", color="C0")
    axes.set_xticks(range(len(goals)), [*KINDS, "box, no word"])
    axes.set(ylabel="goals a minute", ylim=(0, None))
    return figure


EXPERIMENT = Experiment(
    name="things",
    title="Things beside the arm's way, told from people by their history",
    run=run,
    runs=5,
    about=ABOUT,
)
