"""The red ball in somebody's gloved hand: where it is, and where the arm behind it lies."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from armsight.arrays import Points, Vector3
from armsight.motion.perception import PosedFrame
from armsight.servoing.segment import color_mask, regions
from armsight.servoing.sighting import Sighting
from armsight.servoing.targets.ball import Ball
from armsight.servoing.targets.palm import PINK
from armsight.servoing.targets.rehearsal import Disc, rehearse
from armsight.servoing.targets.seen import LEAST, points_of

NEAR, FAR = 0.15, 0.45
"""Glove and sleeve so far from the ball's centre say how the arm lies [m]."""
FEWEST = 6
"""Fewer points say nothing."""


class HeldBall(Ball):
    """Finds a red ball, and along it the glove that holds it."""

    def warm_up(self) -> None:
        """Compile what finds it."""
        rehearsed()

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """See :meth:`.Ball.in_frame`; with ``along`` where enough of the glove is seen."""
        found = super().in_frame(view)
        if not found or view.frame.color is None:
            return found
        parts = [
            points_of(view, region) for region in regions(color_mask(view.frame.color, PINK), LEAST)
        ]
        glove = np.concatenate([np.empty((0, 3)), *parts])
        return [replace(seen, along=_arm(glove, seen.position)) for seen in found]


def _arm(glove: Points, ball: Vector3) -> Vector3 | None:
    """(3,) unit from the ball along the arm; None where too little of that is seen."""
    way = glove - ball
    away = np.linalg.norm(way, axis=1)
    way = way[(away > NEAR) & (away < FAR)]
    if len(way) < FEWEST:
        return None
    middle = way.mean(axis=0)
    return np.asarray(middle / np.linalg.norm(middle))


@cache
def rehearsed() -> tuple[Sighting, ...]:
    """A painted ball beside a painted glove, looked for once."""
    print_ = (Disc(0.04, (205, 30, 25)), Disc(0.05, (242, 77, 158), (0.22, 0.0)))
    return tuple(rehearse(HeldBall(0.04), print_, 0.03))
