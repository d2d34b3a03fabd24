"""The share of V's trials that run in the whole rendered cell, and whether the others agree.

What the other trials draw from a model is rendered here: pictures, looks, the map; and what is
touched is touched by contact physics. The same seed gives the same place, path and start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import JointVector
from armsight.experiments.rows import Row, bootstrap, wilson
from armsight.experiments.servo_eyes import RADIUS, Path
from armsight.experiments.servo_onlooker import Seen, begun, watched
from armsight.experiments.servo_presses import STAYS, Presses
from armsight.experiments.servo_rows import harm_row, median_row, share_row
from armsight.experiments.servo_world import Setup
from armsight.geometry.pose import transform
from armsight.motion.permits import Permit
from armsight.tasks.servo import ServoOptions

SHARE = 10
"""One in so many trials of a row is rendered as well."""


class Reaching:
    """How near the tip truly comes to a ball's surface, and when it is reached.

    Args:
        near: it is reached this near [m].
    """

    def __init__(self, near: float) -> None:
        self.presses, self.gap, self.reached, self._near = Presses(), math.inf, math.inf, near
        self.over = False

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """See :class:`~.servo_onlooker.Judge`."""
        self.presses.look(seen, permit)
        gap = float(np.linalg.norm(seen.tip() - seen.place(seen.now))) - RADIUS
        self.gap = min(self.gap, gap)
        if gap < self._near:
            self.reached = min(self.reached, seen.now)
        self.over = seen.now > self.reached + STAYS


def rendered(
    setup: Setup, path: Path, start: JointVector, seed: int, limit: float, near: float
) -> dict[str, Any]:
    """One trial with a ball; what it came to, as JSON values.

    Args:
        setup: of the cell.
        path: (3,) of the ball in ``base`` at a time [s].
        start: (n,) joints [rad].
        seed: of the cell's errors.
        limit: given up after this [s].
        near: reached this near the ball's surface [m].
    """
    place = transform(setup.workcell.robot.T_world_base, path(0.0)[None])[0]
    cell = begun(setup, {"position": tuple(place.tolist())}, start)
    judge, found = watched(
        cell, setup, ServoOptions(), path, lambda task: Reaching(near), seed, limit
    )
    return {
        "reached": math.isfinite(judge.reached),
        "seconds": judge.reached if math.isfinite(judge.reached) else limit,
        "away": judge.gap,
        "force": judge.presses.force,
        "harm": judge.presses.harm,
        "height": float(place[2]),
        **found,
    }


@dataclass(frozen=True)
class Trials:
    """What came of trials.

    Attributes:
        good: of each, whether it succeeded.
        seconds: of those that did [s].
        off: by how much they were off, where that is what counts [mm].
    """

    good: Sequence[bool]
    seconds: Sequence[float]
    off: Sequence[float] = ()


def agreement(
    name: str, say: str, where: str, shown: Trials, bulk: Trials, harm: Sequence[bool]
) -> list[Row]:
    """Share and time of the rendered trials, and whether they agree with the others.

    Args:
        name: of the experiment's keys.
        say: what happens in trials that succeed.
        where: the rows' condition.
        shown: the rendered trials.
        bulk: the others.
        harm: of each rendered trial, whether it did any.
    """
    rows = [
        share_row(f"rendered_{name}_success", f"share of rendered trials in which {say}", where,
                  shown.good, None),
        median_row(f"rendered_{name}_time_s", "time of the rendered trials that succeeded", where,
                   shown.seconds, "s"),
        Row("rendered_agrees",
            "1 where shares and medians of the rendered trials and of all others agree within "
            "their 95 % intervals", where, float(_agree(shown, bulk)), n=len(shown.good), must=1.0,
            aim=1.0, better="higher"),
        harm_row(f"rendered trials of {name} that pressed above the permit", f"rendered, {where}",
                 sum(harm), len(harm)),
    ]  # fmt: skip
    if shown.off:
        rows.insert(
            1, median_row(f"rendered_{name}_mm", "of the rendered trials", where, shown.off, "mm")
        )
    return rows


def _agree(shown: Trials, bulk: Trials) -> bool:
    """Whether the intervals of the shares overlap, and those of the medians where there are any."""
    spans = []
    for found in (shown, bulk):
        share = wilson(sum(found.good), max(len(found.good), 1))
        rng = np.random.default_rng(0)
        spans.append((share, *(bootstrap(v, rng, "median") for v in (found.seconds, found.off))))
    return not any(a[0] > b[1] or b[0] > a[1] for a, b in zip(*spans))
