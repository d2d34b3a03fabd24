"""``approach-permit``: people reach for an arm that touches something by permit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.experiments.approach_rows import search_rows
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.hand_search import CAPS, Hunter, cross_entropy
from armsight.experiments.quick_cell import Ball, QuickCell, felt
from armsight.experiments.rows import Row, contact_row, share_row
from armsight.experiments.touch_cell import pointing_arm
from armsight.geometry.pose import make_pose
from armsight.motion.intents import VelocityIntent
from armsight.motion.permits import ContactKind, PermitRequest
from armsight.motion.regions import Region
from armsight.robots.kinematics import tcp_pose
from armsight.simulation.truth import MOVING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS = 8.0
"""Length of an episode [s]."""
RADIUS = 0.03
"""Of the ball that is touched [m]."""
HAND = 2.0
"""Speed of the hands that come [m/s]."""
SEARCH_SHARE = 100
"""One search for so many episodes."""
# azimuth about the ball [rad], height above it [m] and distance [m] of the start, time [s], part of
# the body 0..1, lead [s]
MEAN = np.array([0.0, 0.2, 1.0, 3.0, 0.7, 0.15])
SPREAD = np.array([1.8, 0.3, 0.2, 1.5, 0.3, 0.15])
LOWEST = np.array([-np.pi, -0.2, 0.6, 0.6, 0.0, 0.0])
HIGHEST = np.array([np.pi, 0.9, 1.4, 7.0, 1.0, 0.6])

ABOUT = """
A UR5 with a pen goes to a ball on a stand and touches it, by a permit for a `thing` or for a `hand`
(the ball is then what somebody holds, in a region of 10 to 40 cm), in the kinematic cell of the
search: a perfect map, as late as a real one, drives with all their delays. At a random time a hand
(10 cm) that is not the permit's comes at 2.0 m/s from 1.2 m away, at the tool, at another part of
the arm, or at the ball itself, straight or following it. A contact counts when the hand was outside
of the permit's region and the fastest point of the arm was faster than 0.05 m/s. Within the region
of a `hand` power and force limiting holds instead: `inside` has the greatest speed there.

`search_contacts`: likewise, but where the hand starts, when it runs, at which part of the arm and
how far ahead of that is searched for (cross-entropy, 60 trials a search).
"""


def episode(seed: int, run: int) -> dict[str, Any]:
    """One episode; module-level, so that worker processes can import it."""
    rng = np.random.default_rng((seed, run))
    touched = _Touched(rng, run)
    cell = touched.cell(run)
    begin = float(rng.uniform(0.8, 6.5))
    hand = _Hand(cell, touched.place, rng, begin)
    cell.balls.append(Ball(hand))
    touched.run(cell)
    met = [t for t in cell.moving_touches if t.ball == 1]
    outside = [t for t in met if touched.outside(hand.was(t.time), cell.balls[1].radius)]
    held = [s.permit is not None and s.permit.holds for s in cell.log]
    before = [h for s, h in zip(cell.log, held) if 0.5 < s.stamp < begin]
    return {
        "kind": touched.kind,
        "contacts": len(outside),
        "inside": max((t.speed for t in met), default=0.0),
        "worst": max((t.speed for t in outside), default=0.0),
        "reached": any(t.ball == 0 for t in cell.touches),
        "held": float(np.mean(before)) if before else float("nan"),
        "least": min(
            (m.distance for m in cell.margins if m.ball == 1 and m.speed > MOVING), default=9.0
        ),
        "aim": hand.aim,
    }


class _Touched:
    """A ball somewhere, and what an arm asks for to touch it."""

    def __init__(self, rng: np.random.Generator, run: int) -> None:
        self.kind: ContactKind = "thing" if run % 2 == 0 else "hand"
        turn, reach = rng.uniform(-1.3, -0.5), rng.uniform(0.5, 0.65)
        up = rng.uniform(0.25, 0.5)
        self.place = np.array([reach * np.cos(turn), reach * np.sin(turn), up])
        self.size = RADIUS if self.kind == "thing" else float(rng.uniform(0.1, 0.4))

    def cell(self, seed: int) -> QuickCell:
        """With the ball in it."""
        ball = Ball(lambda t: self.place, RADIUS)
        return QuickCell([ball], robot=pointing_arm(), seed=seed)

    def run(self, cell: QuickCell) -> None:
        """Go to the ball and touch it, again and again."""
        while cell.now < SECONDS:
            cell.tick(goal=_wish(cell, self.place, self.kind, self.size))

    def outside(self, place: Vector3, radius: float) -> bool:
        """Whether a ball at a (3,) place is outside of what is asked for [m]."""
        return bool(np.linalg.norm(place - self.place) > self.size + radius)


def search(seed: int, run: int) -> dict[str, Any]:
    """One search for a contact outside the region; module-level, for worker processes."""
    rng = np.random.default_rng((seed, 9, run))
    touched, speed = _Touched(rng, run // len(CAPS)), CAPS[run % len(CAPS)]

    def chased(genes: Floats) -> tuple[float, int]:
        cell = touched.cell(run)
        hunter = Hunter(genes, speed, touched.place)
        hunter.cell = cell
        cell.balls += hunter.balls()
        radius = cell.balls[1].radius
        touched.run(cell)
        near = [m for m in cell.margins if m.ball == 1 and m.speed > MOVING]
        moving = [m for m in near if touched.outside(hunter.at(m.time), radius)]
        met = any(m.distance < 0.0 for m in moving)
        return min((m.distance for m in moving), default=3.0), int(met)

    mean = MEAN.copy()
    mean[0] = rng.uniform(-np.pi, np.pi)
    found = cross_entropy(chased, rng, (mean, SPREAD), (LOWEST, HIGHEST))
    return {"cap": speed, "kind": touched.kind, **found}


class _Hand:
    """Comes from afar at a part of the arm, where that is at each instant, or at the ball."""

    def __init__(
        self, cell: QuickCell, place: Vector3, rng: np.random.Generator, begin: float
    ) -> None:
        self._cell, self._place, self._begin = cell, place, begin
        self.aim = str(rng.choice(["tool", "part", "ball"]))
        self._sphere = int(rng.integers(len(cell.guard.body.radius)))
        self._follows = bool(rng.random() < 0.5)
        way = rng.normal(size=3)
        way[2] = abs(way[2]) * 0.5
        self._at = place + 1.2 * way / np.linalg.norm(way)
        self._last = begin
        self._goal: Vector3 | None = None
        self._been: dict[float, Vector3] = {}

    def was(self, t: float) -> Vector3:
        """(3,) where it was at about a time [s]."""
        return self._been[min(self._been, key=lambda s: abs(s - t))]

    def __call__(self, t: float) -> Vector3:
        if t > self._last:
            if self._goal is None or self._follows:
                self._goal = self._target()
            way = self._goal - self._at
            away = float(np.linalg.norm(way))
            self._at = self._at + way * min(1.0, HAND * (t - self._last) / max(away, 1e-9))
            self._last = t
            self._been[t] = self._at
        return self._at

    def _target(self) -> Vector3:
        cell = self._cell
        if self.aim == "ball":
            return self._place
        center, _ = cell.guard.body.motion(cell.q, cell.v)
        return np.asarray(center[-1 if self.aim == "tool" else self._sphere])


def _wish(cell: QuickCell, place: Vector3, kind: ContactKind, size: float) -> VelocityIntent:
    tip = tcp_pose(cell.robot, cell.q)[:3, 3]
    way = place - tip
    away = max(float(np.linalg.norm(way)), 1e-9)
    velocity = np.zeros(6)
    velocity[:3] = way / away * min(0.4, 2.0 * max(away - 0.5 * RADIUS, 0.0))
    seen = cell.now - 0.09
    region = Region("sphere", (size, 0.0, 0.0), make_pose(None, place), seen, drift=0.02)
    permit = PermitRequest("ball", kind, region, ("tool",), 0.12, 0.25, 30.0, 5.0, 30.0)
    cell.guard.feel(felt(cell))
    return VelocityIntent("touch", velocity, "base", seen, cell.now + 0.1, permit)


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` episodes, and a hundredth as many searches."""
    searches = max(4, runs // SEARCH_SHARE)

    def first(stage: str, done: float) -> None:
        progress(stage, 0.5 * done)

    def second(stage: str, done: float) -> None:
        progress(stage, 0.5 + 0.5 * done)

    episodes = run_episodes("approach-permit", episode, range(runs), seed, first)
    name = "approach-permit-search"
    hunts = run_episodes(name, search, range(searches), seed, second)
    rows = []
    for kind in (None, "thing", "hand"):
        mine = [e for e in episodes if kind in (None, e["kind"])]
        if not mine:
            continue
        condition = "all episodes" if kind is None else f"permit for a {kind}"
        touched = sum(e["contacts"] > 0 for e in mine)
        rows.append(contact_row(touched, "anybody outside the region", condition, len(mine)))
        what = "share of episodes with such a contact (Wilson)"
        rows.append(share_row("contact_share", what, condition, touched, len(mine)))
        rows.append(
            Row(
                "least_moving_m", "least distance of the hand while the arm moved", condition,
                min(e["least"] for e in mine), "m", n=len(mine), better="higher",
            )
        )  # fmt: skip
        reached = sum(e["reached"] for e in mine)
        rows.append(
            Row(
                "touched_share", "episodes in which the ball was touched before or after",
                condition, reached / len(mine), n=len(mine), better="higher",
            )
        )  # fmt: skip
        inside = max(e["inside"] for e in mine)
        measure = (
            "greatest speed of the arm at which the hand was met, the region's inside included"
        )
        rows.append(Row("inside", measure, condition, inside, "m/s", n=len(mine)))
    what = "contacts of the moving arm outside the region that the search forced, in all its trials"
    rows += search_rows(hunts, ("search_contacts", what), ("search_margin_m", "hand at"))
    notes = [
        f"Contact in episode {k} ({e['kind']}, hand at the {e['aim']}): {e['worst']:.2f} m/s."
        for k, e in enumerate(episodes)
        if e["contacts"]
    ]
    return Outcome(tuple(rows), {"distances": lambda: _plot(episodes)}, tuple(notes))


def _plot(episodes: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    axes = figure.subplots()
    for kind in ("thing", "hand"):
        least = [1e3 * e["least"] for e in episodes if e["kind"] == kind and e["least"] < 9.0]
        axes.hist(least, bins=np.linspace(0.0, 1000.0, 41).tolist(), alpha=0.6, label=kind)
    axes.set_xlabel("least distance of the hand while the arm moved [mm]")
    axes.set_ylabel("episodes")
    axes.legend()
    return figure


EXPERIMENT = Experiment(
    "approach-permit", "people reach for an arm that touches something by permit", run, 400, ABOUT
)
