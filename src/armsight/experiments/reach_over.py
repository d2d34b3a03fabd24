"""People who stand at the mapped box and reach into it from above: a search for contact."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.experiments.hand_search import BOX, CAPS, Chaser, chased, cross_entropy
from armsight.experiments.quick_cell import Ball
from armsight.geometry.pose import unit

UPPER, FORE = 0.36, 0.44
"""Shoulder to elbow, elbow to the middle of the hand [m]."""
PIECES = 7
"""Balls along each of the two."""
ARM, HAND, HEAD, TRUNK = 0.045, 0.05, 0.10, 0.13
"""Radii [m]."""
NECK = 0.25
"""From the shoulder to the middle of the head [m]."""
SPINE = (0.05, 0.2, 0.35, 0.5)
"""Balls of the trunk below the shoulder [m]."""
# Where the shoulder is at first: azimuth [rad], distance from the arm's axis and height [m]; where
# the hand waits: bearing from it (0: to the robot) [rad], height [m], share 0..1 of what the arm
# still reaches sideways; swivel of the elbow (0: up) [rad]; start [s], part of the body, lead [s].
MEAN = np.array([0.0, 1.1, 0.8, 0.0, 1.15, 0.9, 0.0, 2.0, 0.7, 0.15])
SPREAD = np.array([1.2, 0.3, 0.05, 0.4, 0.08, 0.2, 0.4, 1.2, 0.3, 0.15])
LOWEST = np.array([-np.pi, 0.3, 0.4, -np.pi, 0.95, 0.0, -np.pi, 0.6, 0.0, 0.0])
HIGHEST = np.array([np.pi, 1.9, 0.83, np.pi, 1.5, 1.0, np.pi, 5.0, 1.0, 0.6])


class Reacher(Chaser):
    """Somebody with an arm up, whose hand runs at a part of the arm.

    The hand takes the arm along, and the arm the body, which leans or steps: nothing of them is
    faster than the hand.
    """

    def __init__(self, genes: Floats, speed: float) -> None:
        azimuth, away, height, bearing, over, share, swivel, begins, part, lead = genes
        super().__init__(begins, part, lead, speed)
        self._swivel = float(swivel)
        self._shoulder = np.array([away * np.cos(azimuth), away * np.sin(azimuth), height])
        up = min(over - height, 0.98 * (UPPER + FORE))
        aside = share * np.sqrt(max((0.99 * (UPPER + FORE)) ** 2 - up**2, 0.0))
        towards = azimuth + np.pi + bearing
        self._hand = self._shoulder + np.array(
            [aside * np.cos(towards), aside * np.sin(towards), up]
        )
        self._elbow = self._bent()

    @property
    def radii(self) -> list[float]:
        """Of the balls [m]."""
        return [*[ARM] * (2 * PIECES), HAND, HEAD, *[TRUNK] * len(SPINE)]

    def balls(self) -> list[Ball]:
        """See :class:`~.hand_search.Chaser`."""

        def ball(k: int, radius: float) -> Ball:
            return Ball(lambda time: np.asarray(self.at(time)[k], float), radius)

        return [ball(k, radius) for k, radius in enumerate(self.radii)]

    def _chase(self, target: Vector3) -> None:
        self._hand = self._moved(self._hand, target)
        way = self._hand - self._shoulder
        far = float(np.linalg.norm(way)) - 0.995 * (UPPER + FORE)
        if far > 0.0:
            self._shoulder = self._moved(self._shoulder, self._shoulder + far * unit(way))
        self._elbow = self._moved(self._elbow, self._bent())

    def _bent(self) -> Vector3:
        """Where the elbow belongs between shoulder and hand."""
        way = self._hand - self._shoulder
        length = max(float(np.linalg.norm(way)), 1e-6)
        along = np.clip((UPPER**2 - FORE**2 + length**2) / (2.0 * length), -UPPER, UPPER)
        axis = way / length
        upwards = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
        if np.linalg.norm(upwards) < 1e-3:
            upwards = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
        upwards = unit(upwards)
        aside = np.cross(axis, upwards)
        out = np.cos(self._swivel) * upwards + np.sin(self._swivel) * aside
        return np.asarray(self._shoulder + along * axis + np.sqrt(UPPER**2 - along**2) * out)

    def _now(self) -> Floats:
        share = (np.arange(PIECES) / PIECES)[:, None]
        upper = self._shoulder + share * (self._elbow - self._shoulder)
        fore = self._elbow + share * (self._hand - self._elbow)
        head = self._shoulder + np.array([0.0, 0.0, NECK])
        spine = self._shoulder - np.multiply.outer(SPINE, [0.0, 0.0, 1.0])
        return np.asarray(np.concatenate([upper, fore, [self._hand], [head], spine]), float)


def reach_over(seed: int, run: int) -> dict[str, Any]:
    """One search by the cross-entropy method; module-level, for worker processes."""
    rng = np.random.default_rng((seed, 9, run))
    speed = CAPS[run % len(CAPS)]
    mean = MEAN.copy()
    mean[0] = rng.uniform(-np.pi, np.pi)
    found = cross_entropy(
        lambda genes: chased(Reacher(genes, speed), run, BOX),
        rng,
        (mean, SPREAD),
        (LOWEST, HIGHEST),
    )
    return {"cap": speed, **found}
