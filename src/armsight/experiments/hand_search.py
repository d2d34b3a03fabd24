"""A search that tries to bring a hand against the moving arm: start, aim, timing and lead."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.experiments.quick_cell import Ball, QuickCell

CAPS = (1.6, 2.0)
"""Speed of the hand [m/s], in turn."""
SECONDS = 6.0
"""Length of a trial [s]."""
GENERATIONS, POPULATION, ELITE = 5, 12, 3
"""Of the cross-entropy method."""
GOALS = (
    np.deg2rad([-55.0, -70.0, 85.0, -105.0, -90.0, 0.0]),
    np.deg2rad([55.0, -70.0, 85.0, -105.0, -90.0, 0.0]),
)
"""What the arm patrols between [rad]; those of the packaged cell."""
RADIUS = 0.05
"""Of the hand [m]."""
DT = 0.01
"""Step of the hand [s]."""
# azimuth [rad], height [m] and distance [m] of the start, time [s], part of the body 0..1, lead [s]
MEAN = np.array([0.0, 0.4, 1.2, 2.0, 0.7, 0.15])
SPREAD = np.array([1.2, 0.3, 0.2, 1.2, 0.3, 0.15])
LOWEST = np.array([-np.pi, 0.0, 0.8, 0.6, 0.0, 0.0])
HIGHEST = np.array([np.pi, 1.1, 1.5, 5.0, 1.0, 0.6])
BOX = np.array([-1.2, -1.2, -0.14]), np.array([1.3, 1.2, 1.02])
"""What the packaged cell maps, in ``base`` [m]: above it nobody is looked for."""
ABOVE_LOWEST = np.array([-np.pi, 1.08, 0.0, 0.8, 0.3, 0.0])
ABOVE_HIGHEST = np.array([np.pi, 1.4, 0.7, 5.0, 1.0, 0.4])
"""Genes of hands that wait above it."""
STANDING = 0.05
"""An arm slower than this counts as standing [m/s]."""


class Hunter:
    """A hand that waits, then runs at full speed at where a part of the arm will be.

    It sees the true arm at every instant, which no person does.
    """

    def __init__(self, genes: Floats, speed: float) -> None:
        azimuth, height, distance, self._begins, part, self._lead = genes
        self._part, self._speed = float(part), speed
        self._place = np.array(
            [distance * np.cos(azimuth), distance * np.sin(azimuth), height], float
        )
        self._path = [self._place.copy()]
        self.cell: QuickCell | None = None

    def center(self, time: float) -> Vector3:
        """(3,) where the hand is at a time that it has lived through, or begins to now [s]."""
        index = round(time / DT)
        while len(self._path) <= index:
            self._step(len(self._path) * DT)
        return self._path[index]

    def _step(self, time: float) -> None:
        if time > self._begins and self.cell is not None:
            center, velocity = self.cell.guard.body.motion(self.cell.q, self.cell.v)
            k = min(int(self._part * len(center)), len(center) - 1)
            way = center[k] + self._lead * velocity[k] - self._place
            length = float(np.linalg.norm(way))
            if length > 1e-9:
                self._place = self._place + way * min(1.0, self._speed * DT / length)
        self._path.append(self._place.copy())


def trial(
    genes: Floats, speed: float, seed: int, box: tuple[Vector3, Vector3] | None = None
) -> tuple[float, int]:
    """Least distance to the moving arm [m], and 1 if it touched it."""
    hunter = Hunter(genes, speed)
    cell = QuickCell([Ball(hunter.center, RADIUS)], GOALS, rate=15.0, seed=seed, box=box)
    hunter.cell = cell
    cell.run(SECONDS)
    moving = [m.distance for m in cell.margins if m.speed > STANDING]
    return min(moving, default=3.0), int(bool(cell.moving_touches))


def cross_entropy(
    one: Callable[[Floats], tuple[float, int]],
    rng: np.random.Generator,
    start: tuple[Floats, Floats],
    bounds: tuple[Floats, Floats],
) -> dict[str, Any]:
    """Looks for the genes that bring somebody nearest to the moving arm.

    Args:
        one: a trial of genes: least distance [m], and 1 if the arm was touched.
        rng: draws the genes.
        start: mean and spread of the first genes.
        bounds: least and greatest.
    """
    mean, spread = start[0].copy(), start[1].copy()
    best, best_genes, contacts, trials = np.inf, mean, 0, 0
    for _ in range(GENERATIONS):
        genes = np.clip(rng.normal(mean, spread, (POPULATION, len(mean))), *bounds)
        found = [one(g) for g in genes]
        margins = np.array([margin for margin, _ in found])
        contacts += sum(touched for _, touched in found)
        trials += POPULATION
        order = np.argsort(margins, kind="stable")
        if margins[order[0]] < best:
            best, best_genes = float(margins[order[0]]), genes[order[0]]
        elite = genes[order[:ELITE]]
        mean, spread = elite.mean(axis=0), elite.std(axis=0) + 0.05 * start[1]
    return {
        "margin": best,
        "genes": [float(g) for g in best_genes],
        "contacts": contacts,
        "trials": trials,
    }


def search(seed: int, run: int) -> dict[str, Any]:
    """One search by the cross-entropy method; module-level, for worker processes."""
    rng = np.random.default_rng((seed, 7, run))
    speed = CAPS[run % len(CAPS)]
    mean = MEAN.copy()
    mean[0] = rng.uniform(-1.5, 1.5)
    found = cross_entropy(
        lambda genes: trial(genes, speed, run), rng, (mean, SPREAD), (LOWEST, HIGHEST)
    )
    return {"cap": speed, **found}


def from_above(seed: int, run: int) -> dict[str, Any]:
    """Hands without anybody, out of space that is in no map: what the proof takes for granted."""
    rng = np.random.default_rng((seed, 8, run))
    speed = CAPS[run % len(CAPS)]
    found = [
        trial(rng.uniform(ABOVE_LOWEST, ABOVE_HIGHEST), speed, run, BOX) for _ in range(POPULATION)
    ]
    return {
        "cap": speed,
        "margin": min(margin for margin, _ in found),
        "contacts": sum(touched for _, touched in found),
        "trials": len(found),
    }
