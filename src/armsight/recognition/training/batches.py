"""Which samples make up an update: a function of seed, stage and update alone.

Nothing of it is state, so a run that goes on from a checkpoint takes the very batches that it
would have taken.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Ints


class Batches:
    """Shuffled passes over samples, cut into batches of equal size that may span two passes.

    Args:
        count: samples.
        size: of a batch.
        seed: of the order.
        stage: number of the training's stage; another order for each.
    """

    def __init__(self, count: int, size: int, seed: int, stage: int) -> None:
        if count < 1 or size < 1:
            raise ValueError(f"{count} samples in batches of {size} make no batch")
        self._count, self._size, self._seed = count, size, (seed, stage)
        self._passes: dict[int, Ints] = {}

    def __getitem__(self, update: int) -> Ints:
        """(size,) positions of the samples of an update, counted from 0."""
        places = np.arange(update * self._size, (update + 1) * self._size)
        number, within = np.divmod(places, self._count)
        wanted = {int(n) for n in number}
        kept = self._passes
        self._passes = {n: kept[n] if n in kept else self._order(n) for n in wanted}
        return np.array([self._passes[int(n)][k] for n, k in zip(number, within, strict=True)])

    def epoch(self, update: int) -> float:
        """Passes over all samples that are over before an update."""
        return update * self._size / self._count

    def _order(self, number: int) -> Ints:
        return np.random.default_rng([*self._seed, 29, number]).permutation(self._count)
