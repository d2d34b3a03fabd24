"""Trials of ``servo-ball`` in the whole rendered cell, and whether the others agree with them.

What the other trials draw from a model is rendered here: pictures, looks, the map; and the ball is
touched by contact physics. The same seed gives the same place, path and start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.experiments.rows import Row, bootstrap, wilson
from armsight.experiments.servo_eyes import RADIUS, Path
from armsight.experiments.servo_presses import STAYS, Presses
from armsight.experiments.servo_rows import harm_row
from armsight.experiments.servo_world import Setup
from armsight.geometry.pose import transform

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.simulation.truth import Contact
    from armsight.simulation.world import SimulatedWorld
    from armsight.workcell.schema import Workcell

BALL = "ball"
SHARE = 10
"""One in so many trials of a row is rendered as well."""


class Onlooker:
    """Leads the ball along its path, and notes how near the tip truly comes.

    Args:
        world: the simulation; path: (3,) of the ball in ``base`` at a time [s]; setup: of the cell.
        near: the ball is reached this near its surface [m].
    """

    name = "onlooker"
    period = 0.008

    def __init__(self, world: SimulatedWorld, path: Path, setup: Setup, near: float) -> None:
        self.world, self.path, self.robot = world, path, setup.robot
        self.presses, self.gap, self.reached = Presses(), math.inf, math.inf
        self.now, self.q = 0.0, np.array(setup.robot.home)
        self._T, self._near = setup.workcell.robot.T_world_base, near
        self._session: Session | None = None

    @property
    def contacts(self) -> list[Contact]:
        """What the arm really touched."""
        return self.world.truth.contacts

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """One round."""
        assert self._session is not None
        self.world.drag(BALL, transform(self._T, self.path(now)[None])[0])
        view = self._session.view()
        if view.joints is None:
            return
        self.now, self.q = now, np.array(view.joints.position)
        self.presses.look(self, None if view.guard is None else view.guard.permit)
        gap = float(np.linalg.norm(self.world.truth.tip_position() - self._place())) - RADIUS
        self.gap = min(self.gap, gap)
        if gap < self._near:
            self.reached = min(self.reached, now)
        if now > self.reached + STAYS:
            self._session.stop("touched")

    def _place(self) -> Vector3:
        """(3,) where the ball is in world: it gives way [m]."""
        ball = next(m for m in self.world.movers() if m.name == BALL)
        return np.asarray(ball.T_world_solid[:3, 3])


def rendered(
    setup: Setup, path: Path, start: JointVector, seed: int, limit: float, near: float
) -> dict[str, Any]:
    """One trial; what it came to, as JSON values.

    Args:
        setup: of the cell.
        path: (3,) of the ball in ``base`` at a time [s].
        start: (n,) joints [rad].
        seed: of the cell's errors.
        limit: given up after this [s].
        near: reached this near the ball's surface [m].
    """
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.tasks.servo import ServoOptions
    from armsight.workcell import open_cell, simulated_world

    with open_cell(_cell(setup, path(0.0), start), seed) as cell:
        looks = Onlooker(simulated_world(cell), path, setup, near)
        task = ServoOptions().make(cell)
        mode = SessionMode(cell_is_empty=True)
        session = Session(cell, task, seed=seed, observers=(looks,), mode=mode)
        session.warm_up()
        session.run(limit)
        guard = session.status()
        return {
            "reached": math.isfinite(looks.reached),
            "seconds": looks.reached if math.isfinite(looks.reached) else limit,
            "away": looks.gap,
            "force": looks.presses.force,
            "harm": looks.presses.harm,
            "last": "" if guard is None else guard.reason,
            "permit": "" if guard is None else str(guard.permit or ""),
            "height": float(transform(setup.workcell.robot.T_world_base, path(0.0)[None])[0, 2]),
            "factor": float(session.realtime_factor),
        }


def _cell(setup: Setup, place: Vector3, start: JointVector) -> Workcell:
    """The cell's file with the arm at its start and the ball at (3,) in ``base``, pushing back."""
    workcell = setup.workcell
    home = tuple(np.rad2deg(start).tolist())
    world = transform(workcell.robot.T_world_base, place[None])[0]
    ball = workcell.simulation.target[0].model_copy(
        update={"path": "free", "position": tuple(world.tolist())}
    )
    simulation = workcell.simulation.model_copy(update={"target": (ball,), "contact_pushes": True})
    robot = workcell.robot.model_copy(update={"home_deg": home})
    return workcell.model_copy(update={"robot": robot, "simulation": simulation})


def agreement(
    where: str, shown: Sequence[dict[str, Any]], bulk: Sequence[dict[str, Any]]
) -> list[Row]:
    """Share and time of the rendered trials, and whether they agree with the others."""
    low, high = wilson(sum(r["reached"] for r in shown), max(len(shown), 1))
    times = [r["seconds"] for r in shown if r["reached"]]
    span = bootstrap(times, np.random.default_rng(0), "median")
    share = sum(r["reached"] for r in shown) / max(len(shown), 1)
    return [
        Row("rendered_ball_success",
            "share of rendered trials in which the tip came within 5 mm of the ball's surface, "
            "95 % by Wilson", where, share, n=len(shown), low=low, high=high, better="higher"),
        Row("rendered_ball_time_s",
            "median time to within 5 mm, of the rendered trials that got there; 95 % by bootstrap",
            where, float(np.median(times)) if times else math.nan, "s", len(times), *span,
            why="no trial got there"),
        Row("rendered_agrees",
            "1 where shares and median times of the rendered trials and of all others agree within "
            "their 95 % intervals", where, float(_agree(shown, bulk)), n=len(shown), must=1.0,
            aim=1.0, better="higher"),
        harm_row(
            "rendered trials in which the ball was pressed above the permit", f"rendered, {where}",
            sum(r["harm"] for r in shown), len(shown)),
    ]  # fmt: skip


def _agree(shown: Sequence[dict[str, Any]], bulk: Sequence[dict[str, Any]]) -> bool:
    """Whether the intervals of the shares overlap, and those of the median times if there are."""
    spans = []
    for found in (shown, bulk):
        times = [r["seconds"] for r in found if r["reached"]]
        share = wilson(sum(r["reached"] for r in found), max(len(found), 1))
        spans.append((share, bootstrap(times, np.random.default_rng(0), "median")))
    return not any(a[0] > b[1] or b[0] > a[1] for a, b in zip(*spans))
