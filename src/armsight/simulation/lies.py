"""Depth cameras that lie: well-formed pictures with fresh stamps of what the lens does not see."""

from __future__ import annotations

from collections import deque
from typing import Final, Literal, get_args

import numpy as np

from armsight.arrays import DepthImage

LieKind = Literal["far", "old", "mirror", "neighbour", "cover"]
"""Everything at nine tenths of the range, with noise; the picture of ``amount`` seconds ago; left
and right exchanged; another camera's picture; half of the lens covered."""
LIES: Final[tuple[LieKind, ...]] = get_args(LieKind)


class Liar:
    """What a camera tells in place of its pictures.

    Attributes:
        neighbour: whose pictures it may tell.
        newest: its own true picture.
    """

    def __init__(self, far: float, seed: tuple[int, ...]) -> None:
        self._far, self._seed = far, seed
        self.neighbour: Liar | None = None
        self.reset()

    def reset(self) -> None:
        """Forget every picture."""
        self.newest: DepthImage | None = None
        self._kept: deque[tuple[float, DepthImage]] = deque()

    def keep(self, depth: DepthImage, now: float, seconds: float | None) -> None:
        """Remember a true picture, and the older ones for so long [s]; None: no older ones."""
        self.newest = depth
        if seconds is None:  # a second of four cameras is 50 MB
            self._kept.clear()
            return
        self._kept.append((now, depth))
        while self._kept[0][0] < now - seconds - 1.0:
            self._kept.popleft()

    def tell(self, kind: LieKind, depth: DepthImage, now: float, amount: float) -> DepthImage:
        """(h, w) what is delivered instead of a true picture [m]."""
        if kind == "far":
            rng = np.random.default_rng((*self._seed, round(now * 1e6)))
            noise = rng.normal(0.0, 0.01, depth.shape)
            return np.asarray(0.9 * self._far + noise, np.float32)
        if kind == "old":
            earlier = [d for at, d in self._kept if at <= now - amount]
            return earlier[-1] if earlier else self._kept[0][1]
        if kind == "mirror":
            return np.ascontiguousarray(depth[:, ::-1])
        if kind == "cover":
            out = depth.copy()
            out[:, : depth.shape[1] // 2] = np.nan
            return out
        other = None if self.neighbour is None else self.neighbour.newest
        return depth if other is None or other.shape != depth.shape else other
