"""One episode of ``approach``: somebody comes near an arm at work."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments.approach_people import SECONDS, Lead, LedHand, from_afar, visitor
from armsight.experiments.approach_use import Onlooker, course
from armsight.experiments.episodes import (
    Watch,
    least_moving_distance,
    packaged_cell,
    with_simulation,
)
from armsight.motion.data import GuardMode
from armsight.simulation.truth import MOVING

if TYPE_CHECKING:
    from armsight.simulation.truth import Truth

CAPS = (1.6, 2.0)
"""Greatest speed of the hands, in turn [m/s]."""
TRACED = 16
"""Episodes of which the course is kept, for the plot."""


def episode(seed: int, run: int) -> dict[str, Any]:
    """One episode; module-level, so that worker processes can import it."""
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    rng = np.random.default_rng((seed, run))
    cap = CAPS[run % len(CAPS)]
    workcell = packaged_cell()
    person = visitor(rng, run, cap)
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
        watch, onlooker = Watch(), Onlooker(cell)
        hands = (LedHand(cell, lead),) if led else ()
        session = Session(cell, task, seed=run, observers=(watch, onlooker, *hands))
        session.run(SECONDS)
        truth = simulated_world(cell).truth
        return {
            "cap": cap,
            "how": person.clip.split("/")[-2] if person.clip else person.script,
            "led": led,
            "from_afar": from_afar(run),
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
            **course(onlooker),
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


def empty(seed: int, run: int) -> dict[str, Any]:
    """The same cell with nobody in it: what the arm does in an episode's time."""
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell

    rng = np.random.default_rng((seed, run))
    workcell = with_simulation(packaged_cell(), person=())
    with open_cell(workcell, seed=int(rng.integers(2**31))) as cell:
        task, onlooker = PatrolTask(workcell.goals, dwell=0.0), Onlooker(cell)
        Session(cell, task, seed=run, observers=(onlooker,)).run(SECONDS)
        moving = [v for v in onlooker.speed if v > MOVING]
        return {
            "goals": len(task.times),
            "speed": float(np.mean(moving)),
            "top": max(moving),
            "reach": max(onlooker.reach),
        }
