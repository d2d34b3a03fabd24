"""What an arm is good for while people are near, beside what others would allow it.

Two baselines with the same proof that nobody is touched, told what is true and charged with the
same reaction time. *Distance alone*: a speed-and-separation monitor that slows the arm by its
distance to the nearest person, whichever way either goes (ISO/TS 15066). *Zone*: a scanner that
stops the arm while anybody is within the arm's reach and the protective distance of its full
speed. Both are counted in their favour: an arm that may go at a share of its speed does that share
of its goals, at once and without planning anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Ints, Vector3
from armsight.experiments.rows import Row, wilson
from armsight.motion.separation import Separation
from armsight.simulation.truth import MOVING

if TYPE_CHECKING:
    from armsight.workcell import Cell

NEAR = 1.5
"""Somebody is near within this distance of the arm [m]."""
COULD, CREEP = 0.1, 0.1
"""An arm that reacts within this time [s] could move this fast [m/s] or faster."""
REACTION = 0.21
"""Reaction time of the baselines: that of the guard in this cell [s]."""
BRAKE = 3.0
"""Deceleration of the tip [m/s^2] (assumption)."""
FAR = 9.0
"""Nobody is there [m]."""


class Onlooker:
    """Looks at the truth 50 times a second.

    Attributes:
        distance: from the arm to the nearest person [m]; speed: of the tip [m/s].
        around: from the base's axis to the nearest person, along the floor [m].
        reach: of the tip, from the same axis [m].
    """

    name = "onlooker"
    period = 0.02

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._tip: Vector3 | None = None
        self.distance: list[float] = []
        self.speed: list[float] = []
        self.around: list[float] = []
        self.reach: list[float] = []

    def update(self, now: float) -> None:
        """Look."""
        from armsight.workcell import simulated_world

        world = simulated_world(self._cell)
        base, tip = self._cell.T_world_base[:2, 3], world.truth.tip_position()
        if self._tip is not None:
            self.speed.append(float(np.linalg.norm(tip - self._tip)) / self.period)
            seen = world.truth.separations
            self.distance.append(float(min(seen[-1].distance if seen else FAR, FAR)))
            parts = [float(np.hypot(*(m.T_world_solid[:2, 3] - base))) for m in world.movers()]
            self.around.append(min(parts, default=FAR))
            self.reach.append(float(np.hypot(*(tip[:2] - base))))
        self._tip = tip


def course(seen: Onlooker) -> dict[str, Any]:
    """What an episode keeps of it."""
    return {
        "tip_speed": [round(v, 3) for v in seen.speed],
        "distance": [round(v, 3) for v in seen.distance],
        "around": [round(v, 3) for v in seen.around],
    }


def near_looks(episodes: Sequence[dict[str, Any]]) -> Ints:
    """(k, 2) of each episode: looks at somebody near an arm that could move; at one that did."""
    law = Separation()
    out = np.zeros((len(episodes), 2), int)
    for counts, e in zip(out, episodes):
        for distance, speed in zip(e["distance"], e["tip_speed"]):
            if distance < NEAR and law.allowed_speed(distance, COULD, BRAKE) >= CREEP:
                counts += (1, speed > MOVING)
    return out


def _near_interval(looks: Ints) -> tuple[float, float]:
    """95 % of the share; looks of one episode are not independent, so episodes are drawn."""
    rng = np.random.default_rng(0)
    could, moved = looks[rng.integers(0, len(looks), (2000, len(looks)))].sum(axis=1).T
    low, high = np.percentile(moved / np.maximum(could, 1), [2.5, 97.5])
    return float(low), float(high)


def distance_alone(episodes: Sequence[dict[str, Any]], full: float) -> float:
    """Share of its full speed [m/s] that distance alone allows the arm, mean over all looks."""
    law = Separation()
    return float(
        np.mean(
            [
                min(law.allowed_speed(d, REACTION, BRAKE, REACTION) / full, 1.0)
                for e in episodes
                for d in e["distance"]
            ]
        )
    )


def zone(episodes: Sequence[dict[str, Any]], reach: float, top: float) -> float:
    """Share of the looks with nobody in the zone of an arm of a reach [m] and a speed [m/s]."""
    radius = reach + Separation().protective_distance(top, REACTION, BRAKE)
    return float(np.mean([d > radius for e in episodes for d in e["around"]]))


def use_rows(
    episodes: Sequence[dict[str, Any]], alone: Sequence[dict[str, Any]], minute: float
) -> list[Row]:
    """What is reported of it.

    Args:
        episodes: with people.
        alone: the same cell without.
        minute: episodes in a minute.
    """
    empty = float(np.mean([e["goals"] for e in alone])) * minute
    mean, top = float(np.mean([e["speed"] for e in alone])), max(e["top"] for e in alone)
    goals = float(np.mean([e["goals"] for e in episodes])) * minute
    looks = near_looks(episodes)
    could, moved = (int(n) for n in looks.sum(axis=0))
    low, high = _near_interval(looks)
    rows = [
        _never(episodes, False),
        _never(episodes, True),
        Row(
            "moving_share_near",
            "looks at which the arm moved, of those with somebody within 1.5 m at which S_p with a "
            "reaction time of 0.1 s would have let it",
            "all episodes",
            moved / max(could, 1),
            n=could,
            low=low,
            high=high,
            must=0.5,
            aim=0.8,
            better="higher",
        ),
        _goals("goals_per_minute", "goals reached although people come, mean", goals, episodes),
        _goals("empty_goals_per_minute", "the same cell with nobody in it", empty, alone),
    ]
    for key, what, share in (
        ("ssm_goals_per_minute", "a monitor that slows by distance alone (baseline)",
         distance_alone(episodes, mean)),
        ("zone_goals_per_minute", "a scanner's zone that stops (baseline)",
         zone(episodes, max(e["reach"] for e in alone), top)),
    ):  # fmt: skip
        rows.append(_goals(key, what, share * empty, episodes))
    return rows


def _never(episodes: Sequence[dict[str, Any]], afar: bool) -> Row:
    mine = [e for e in episodes if e["from_afar"] is afar]
    stood = sum(max(e["tip_speed"], default=0.0) <= MOVING for e in mine)
    low, high = wilson(stood, max(len(mine), 1))
    return Row(
        "never_moved",
        "share of episodes in which the arm never moved",
        "nobody near at first" if afar else "somebody near from the start",
        stood / max(len(mine), 1),
        n=len(mine),
        low=low,
        high=high,
    )


def _goals(key: str, what: str, value: float, episodes: Sequence[dict[str, Any]]) -> Row:
    ours = key == "goals_per_minute"
    return Row(
        key,
        what,
        "all episodes",
        value,
        "1/min",
        n=len(episodes),
        must=8.0 if ours else None,
        aim=12.0 if ours else None,
        better="higher",
    )
