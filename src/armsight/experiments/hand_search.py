"""A search that tries to bring a hand against the moving arm: start, aim, timing and lead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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


class Chaser:
    """Somebody who waits, then runs at full speed at where a part of the arm will be.

    They see the true arm at every instant, which no person does.

    Args:
        begins: when they run [s].
        part: of the arm, 0..1; lead: how far ahead of it they aim [s].
        speed: of them [m/s].

    Attributes:
        cell: in which the arm is.
    """

    def __init__(self, begins: float, part: float, lead: float, speed: float) -> None:
        self._begins, self._part = float(begins), float(part)
        self._lead, self._speed = float(lead), speed
        self._path: list[Floats] = []
        self.cell: QuickCell | None = None

    def at(self, time: float) -> Floats:
        """What there is of them at a time that they have lived through, or begin to now [s]."""
        index = round(time / DT)
        while len(self._path) <= index:
            if self.cell is not None and len(self._path) * DT > self._begins:
                center, velocity = self.cell.guard.body.motion(self.cell.q, self.cell.v)
                k = min(int(self._part * len(center)), len(center) - 1)
                self._chase(center[k] + self._lead * velocity[k])
            self._path.append(self._now())
        return self._path[index]

    def balls(self) -> list[Ball]:
        """What the cell sees."""
        raise NotImplementedError

    def _chase(self, target: Vector3) -> None:
        """A step of DT towards a (3,) place [m]."""
        raise NotImplementedError

    def _now(self) -> Floats:
        raise NotImplementedError

    def _moved(self, place: Vector3, to: Vector3) -> Vector3:
        """A (3,) place [m] after DT towards another, no faster than they are."""
        way = to - place
        length = float(np.linalg.norm(way))
        return np.asarray(place + way * min(1.0, self._speed * DT / max(length, 1e-9)))


class Hunter(Chaser):
    """A hand alone, whose genes are about a (3,) place [m]."""

    def __init__(
        self, genes: Floats, speed: float, about: Sequence[float] | Vector3 = (0.0, 0.0, 0.0)
    ) -> None:
        azimuth, height, distance, begins, part, lead = genes
        super().__init__(begins, part, lead, speed)
        self._place = np.array(
            [distance * np.cos(azimuth), distance * np.sin(azimuth), height], float
        )
        self._place += about

    def balls(self) -> list[Ball]:
        """See :class:`Chaser`."""
        return [Ball(self.at, RADIUS)]

    def _chase(self, target: Vector3) -> None:
        self._place = self._moved(self._place, target)

    def _now(self) -> Floats:
        return self._place


def chased(
    chaser: Chaser, seed: int, box: tuple[Vector3, Vector3] | None = None
) -> tuple[float, int]:
    """Least distance to a part of the arm that moves [m], and 1 if such a part touched them."""
    cell = QuickCell(chaser.balls(), GOALS, rate=15.0, seed=seed, box=box)
    chaser.cell = cell
    cell.run(SECONDS)
    least = min((m.moving for m in cell.margins), default=np.inf)
    return min(least, 3.0), int(least < 0.0)


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
        lambda genes: chased(Hunter(genes, speed), run), rng, (mean, SPREAD), (LOWEST, HIGHEST)
    )
    return {"cap": speed, **found}


def from_above(seed: int, run: int) -> dict[str, Any]:
    """Hands without anybody, out of space that is in no map: what the proof takes for granted."""
    rng = np.random.default_rng((seed, 8, run))
    speed = CAPS[run % len(CAPS)]
    found = [
        chased(Hunter(rng.uniform(ABOVE_LOWEST, ABOVE_HIGHEST), speed), run, BOX)
        for _ in range(POPULATION)
    ]
    return {
        "cap": speed,
        "margin": min(margin for margin, _ in found),
        "contacts": sum(touched for _, touched in found),
        "trials": len(found),
    }
