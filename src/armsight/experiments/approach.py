"""``approach``: people reach in at up to 2 m/s, and a search tries to force a contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.episodes import (
    Watch,
    find_clips,
    least_moving_distance,
    packaged_cell,
    run_episodes,
    with_simulation,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.hand_search import search
from armsight.experiments.rows import Row, contact_row, wilson
from armsight.motion.data import GuardMode

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from armsight.simulation.truth import Truth
    from armsight.workcell import Cell
    from armsight.workcell.schema_things import PersonSection

SECONDS = 4.0
"""Length of an episode [s]; the arm is under way from 0.4 s on."""
CAPS = (1.6, 2.0)
"""Greatest speed of the hands, in turn [m/s]."""
SEARCH_SHARE = 50
"""One search for so many episodes."""
SCRIPTS = ("reach_in", "walk_in", "wave", "walk_by")
VISITOR = "visitor"
TRACED = 16
"""Episodes of which the course is kept, for the plot."""
LOOK = 0.02
"""A led hand is aimed anew this often [s]."""

ABOUT = """
Each episode is four seconds of patrol without rests in the packaged cell `ur5_four_cameras`, with
rendered depth, sensor noise, delays and calibration errors. Someone is there: every second episode
plays a recorded clip, faster or slower, mirrored and placed at random around
the arm; the others play a built-in script (without the recordings, all do). In every second one of
each the right hand leaves that motion at a random time and goes straight at a part of the arm, at
full speed from the first instant; half of these hands follow the arm, the others keep to where it
was heading. Hands are capped at 1.6 and 2.0 m/s in turn. A contact counts when the touching part of
the arm moved faster than 0.05 m/s.

The search looks for start, aim, timing and lead of a hand at full speed (both caps) that comes
nearest to the moving arm, by the cross-entropy method, in a cell without pictures but with the same
delays. It tries to break the guard, so its hands run after the arm as no recorded person does.
"""


@dataclass(frozen=True)
class Lead:
    """A hand that goes for the arm.

    Attributes:
        begins: when [s].
        part: which of the body's spheres, as a share of their number, 0..1.
        ahead: aims at where that part will be after this time [s].
        follows: keeps aiming; else it goes on to where it aimed first.
    """

    begins: float
    part: float
    ahead: float
    follows: bool


class LedHand:
    """Leads the right hand of the cell's person; an observer that knows the truth, as eyes do."""

    name = "led hand"
    period = LOOK

    def __init__(self, cell: Cell, lead: Lead) -> None:
        spheres = cell.robot.spheres
        moving = np.flatnonzero(np.asarray(spheres.link) > 0)
        chosen = moving[min(int(lead.part * len(moving)), len(moving) - 1)]
        self._cell, self._lead = cell, lead
        self._link = int(spheres.link[chosen])
        self._local = np.append(np.asarray(spheres.center[chosen], float), 1.0)
        self._before: Vector3 | None = None
        self._aimed = False

    def update(self, now: float) -> None:
        """Aim."""
        from armsight.workcell import simulated_world

        world = simulated_world(self._cell)
        place = (world.truth.link_poses()[self._link] @ self._local)[:3]
        if self._before is not None and now >= self._lead.begins:
            if self._lead.follows or not self._aimed:
                velocity = (place - self._before) / LOOK
                world.drag(VISITOR, place + self._lead.ahead * velocity)
            self._aimed = True
        self._before = place


def episode(seed: int, run: int) -> dict[str, Any]:
    """One episode; module-level, so that worker processes can import it."""
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    rng = np.random.default_rng((seed, run))
    cap = CAPS[run % len(CAPS)]
    workcell = packaged_cell()
    person = _visitor(rng, run, cap)
    lead = Lead(
        begins=float(rng.uniform(0.5, 2.5)),
        part=float(rng.random()),
        ahead=float(rng.uniform(0.0, 0.4)),
        follows=bool(rng.random() < 0.5),
    )
    led = run // 4 % 2 == 1
    workcell = with_simulation(workcell, person=(person,))
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        task = PatrolTask(workcell.goals, dwell=0.0)
        watch = Watch()
        hands = (LedHand(cell, lead),) if led else ()
        session = Session(cell, task, seed=run, observers=(watch, *hands))
        session.run(SECONDS)
        truth = simulated_world(cell).truth
        return {
            "cap": cap,
            "how": person.clip.split("/")[-2] if person.clip else person.script,
            "led": led,
            "contacts": sum(c.kind == "person" for c in truth.moving_contacts),
            "other_contacts": sum(c.kind != "person" for c in truth.moving_contacts),
            "standing_contacts": sum(not c.moving for c in truth.contacts),
            "worst": _worst(truth.moving_contacts),
            "least": float(min(truth.min_distance, 3.0)),
            "least_moving": least_moving_distance(cell),
            "goals": len(task.times),
            "reflexes": watch.log[-1].reflexes if watch.log else 0,
            "moved": watch.share(GuardMode.PREDICTIVE, GuardMode.SLOWED),
            "stopped": watch.share(GuardMode.STOPPED, GuardMode.REFLEX),
            "trace": _trace(watch, truth) if run < TRACED else {},
        }


def _trace(watch: Watch, truth: Truth) -> dict[str, Any]:
    """What the guard saw, demanded and allowed over time, and the truth beside it."""
    seen = [s for s in watch.log if np.isfinite(s.distance)]
    return {
        "time": [round(s.stamp, 3) for s in seen],
        "distance": [round(s.distance, 3) for s in seen],
        "protective": [round(s.protective_distance, 3) for s in seen],
        "scale": [round(s.speed_scale, 3) for s in seen],
        "true_time": [round(s.time, 3) for s in truth.separations],
        "true_distance": [round(min(s.distance, 3.0), 3) for s in truth.separations],
        "tip_speed": [round(s.tip_speed, 3) for s in truth.separations],
    }


def _worst(contacts: Sequence[Any]) -> list[Any]:
    """Time, link and speed of the fastest contact, for whoever studies it."""
    if not contacts:
        return []
    worst = max(contacts, key=lambda c: c.arm_speed)
    return [round(worst.start, 3), int(worst.link), round(worst.arm_speed, 3), worst.part]


def _visitor(rng: np.random.Generator, run: int, cap: float) -> PersonSection:
    """Who comes in this episode, and from where."""
    from armsight.workcell.schema_things import PersonSection

    clips = find_clips()
    around = float(rng.uniform(-75.0, 75.0))
    direction = np.array([np.cos(np.deg2rad(around)), np.sin(np.deg2rad(around))])
    common: dict[str, Any] = {
        "name": VISITOR,
        "max_hand_speed": cap,
        "mirror": bool(rng.random() < 0.5),
        "height": float(rng.uniform(1.55, 1.90)),
        "start_s": float(rng.uniform(0.3, 1.5)),
    }
    if clips and run // 2 % 2 == 0:
        clip = clips[int(rng.integers(len(clips)))]
        scale = float(rng.uniform(0.8, 2.5))
        played = (SECONDS - common["start_s"]) * scale
        inwards = _hands_reach(clip, played) - float(rng.uniform(0.15, 0.65))
        x, y = -inwards * direction
        return PersonSection(
            motion="clip",
            clip=str(clip),
            position=(float(x), float(y), 0.0),
            yaw_deg=around,
            speed_scale=scale,
            **common,
        )
    script = SCRIPTS[int(rng.integers(len(SCRIPTS)))]
    scale = float(rng.uniform(1.0, 3.0))
    common |= {"motion": "script", "script": script, "speed_scale": scale}
    if script == "walk_by":  # past the bench, a metre and more from the arm's base
        aside = np.array([-direction[1], direction[0]])
        x, y = rng.uniform(0.9, 1.2) * direction - 1.2 * aside
        facing = around + 90.0
    else:
        walk = 1.0 if script == "walk_in" else 0.0
        x, y = direction * (rng.uniform(1.0, 1.4) + walk)
        facing = around + 180.0
    return PersonSection(
        position=(float(x), float(y), 0.0),
        yaw_deg=facing,
        period_s=float(rng.uniform(4.0, 6.0)),
        distance=1.0 if script == "walk_in" else 2.5,
        **common,
    )


def _hands_reach(clip: Path, played: float) -> float:
    """How near a clip's hands come to its robot's axis in the part that is played [m]."""
    from armsight.simulation.clips import load_clip
    from armsight.simulation.skeleton import INDEX

    motion = load_clip(clip)
    joints = motion.joints[: max(2, int(played * motion.rate))]
    hands = joints[:, [INDEX["left_hand"], INDEX["right_hand"]], :2]
    return float(np.linalg.norm(hands, axis=2).min())


def settings() -> dict[str, Any]:
    """All that changes an episode, besides its seed."""
    return {"seconds": SECONDS, "caps": list(CAPS), "clips": len(find_clips()), "version": 4}


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` episodes, and a fiftieth as many searches."""
    searches = max(2, runs // SEARCH_SHARE)

    def first(stage: str, done: float) -> None:
        progress(stage, 0.9 * done)

    def second(stage: str, done: float) -> None:
        progress(stage, 0.9 + 0.1 * done)

    episodes = run_episodes("approach", episode, range(runs), seed, settings(), first)
    hunts = run_episodes("approach-search", search, range(searches), seed, {"version": 4}, second)
    notes = [
        f"Contact in episode {k} (cap {e['cap']} m/s, {e['how']}): "
        f"time [s], link, arm speed [m/s], part: {e['worst']}."
        for k, e in enumerate(episodes)
        if e["contacts"]
    ]
    if not find_clips():
        notes.append("The recorded clips were not there: all episodes play scripts.")
    return Outcome(
        tuple(_rows(episodes, hunts)),
        {"distances": lambda: _plot(episodes), "course": lambda: _plot_course(episodes)},
        tuple(notes),
    )


def _rows(episodes: list[dict[str, Any]], hunts: list[dict[str, Any]]) -> list[Row]:
    rows = []
    for cap in (None, *CAPS):
        mine = [e for e in episodes if cap in (None, e["cap"])]
        if not mine:
            continue
        condition = "all episodes" if cap is None else f"hands up to {cap} m/s"
        contacts = sum(e["contacts"] for e in mine)
        rows.append(contact_row(contacts, "a person", condition, len(mine)))
        touched = sum(e["contacts"] > 0 for e in mine)
        low, high = wilson(touched, len(mine))
        rows.append(
            Row(
                "contact_share",
                "share of episodes with such a contact, and its 95 % interval (Wilson)",
                condition,
                touched / len(mine),
                n=len(mine),
                low=low,
                high=high,
            )
        )
        near = [e["least_moving"] for e in mine]
        rows.append(
            Row(
                "least_moving_m",
                "least true distance to a person while the arm moved, 5 % quantile beside it",
                condition,
                min(near),
                "m",
                n=len(mine),
                low=min(near),
                high=float(np.quantile(near, 0.05)),
                paper=0.02 if cap is None else None,
            )
        )
    other = sum(e["other_contacts"] for e in episodes)
    rows.append(
        Row(
            "other_contacts",
            "contacts of the moving arm with anything that is no person",
            "all episodes",
            float(other),
            n=len(episodes),
        )
    )
    rows.append(
        Row(
            "moving_share",
            "share of the time in which the arm followed a path, mean: a guard that never lets it "
            "move touches nobody either",
            "all episodes",
            float(np.mean([e["moved"] for e in episodes])),
            n=len(episodes),
            better="higher",
        )
    )
    rows.append(
        Row(
            "standing_contacts",
            "contacts with an arm that stood or moved at less than 0.05 m/s: people touch it",
            "all episodes",
            float(sum(e["standing_contacts"] for e in episodes)),
            n=len(episodes),
        )
    )
    goals = [float(e["goals"]) for e in episodes]
    rows.append(
        Row(
            "goals_per_minute",
            "goals reached although people come, mean",
            "all episodes",
            float(np.mean(goals)) * 60.0 / SECONDS,
            "1/min",
            n=len(goals),
            better="higher",
        )
    )
    for cap in CAPS:
        mine = [h for h in hunts if h["cap"] == cap]
        if not mine:
            continue
        touched = sum(h["contacts"] for h in mine)
        rows.append(
            Row(
                "search_contacts",
                "contacts of the moving arm that the search forced, in all its trials",
                f"hand at {cap} m/s",
                float(touched),
                n=sum(h["trials"] for h in mine),
                must=0.0,
                aim=0.0,
            )
        )
        margins = [h["margin"] for h in mine]
        rows.append(
            Row(
                "search_margin_m",
                "least distance to the moving arm that the search found",
                f"hand at {cap} m/s",
                min(margins),
                "m",
                n=sum(h["trials"] for h in mine),
                better="higher",
            )
        )
    return rows


def _plot(episodes: list[dict[str, Any]]) -> Figure:
    """How near people came, in all and while the arm moved."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.5))
    axes = figure.subplots()
    bins = np.linspace(0.0, 1.5, 46).tolist()
    for key, label in (("least", "arm standing or moving"), ("least_moving", "while it moved")):
        axes.hist(np.minimum([e[key] for e in episodes], 1.5), bins, alpha=0.6, label=label)
    axes.set(xlabel="least true distance of an episode [m]", ylabel="episodes")
    axes.legend()
    return figure


def _plot_course(episodes: list[dict[str, Any]]) -> Figure:
    """Distance, protective distance and speed over one episode: the liveliest with a led hand."""
    from matplotlib.figure import Figure

    traced = [e for e in episodes if e["trace"]]
    shown = max(traced, key=lambda e: (e["led"] and e["least"] < 0.2, e["moved"]))
    t = shown["trace"]
    figure = Figure(figsize=(8, 5))
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(t["time"], t["distance"], label="distance to whoever may be nearest, as seen")
    above.plot(t["time"], t["protective"], "--", label="protective distance at the present speed")
    above.plot(t["true_time"], t["true_distance"], color="tab:green", label="true distance to skin")
    above.set(ylabel="[m]", ylim=(0.0, 1.4))
    above.legend(loc="upper right", fontsize=8)
    below.plot(t["true_time"], t["tip_speed"], color="tab:red", label="true speed of the tip [m/s]")
    below.plot(t["time"], t["scale"], color="tab:gray", lw=1, label="speed scale")
    below.set(xlabel="time [s]", ylim=(0.0, None))
    below.legend(loc="upper right", fontsize=8)
    figure.align_ylabels()
    return figure


EXPERIMENT = Experiment(
    name="approach",
    title="People reach in at up to 2 m/s; a search tries to force a contact",
    run=run,
    runs=1000,
    about=ABOUT,
)
