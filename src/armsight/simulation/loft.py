"""Rounded bodies from rings: each ring an ellipse across an axis, the skin stretched over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, Points
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid

Ring = tuple[float, float, float, float]
"""Height along z, half width along x, half width along y, offset along x [m]."""


@dataclass(frozen=True)
class Loft:
    """A body along z.

    Attributes:
        name: of the piece.
        rings: (k, 4) see :data:`Ring`, ascending in height.
        look: skin, hair, eyes, shirt, trousers or shoes.
        pieces: convex pieces that its contact needs; 0: seen but never touched.
        turn: (3, 3) rotation from the loft's axes to its body part's.
        origin: (3,) of the loft in the body part [m].
        segments: facets around.
    """

    name: str
    rings: Floats
    look: str
    pieces: int = 1
    turn: Floats | None = None
    origin: Floats | None = None
    segments: int = 16

    def mesh(self) -> tuple[Points, Ints]:
        """(v, 3) vertices in the body part's frame [m] and (f, 3) faces, outward."""
        k, n = len(self.rings), self.segments
        angle = 2.0 * np.pi * np.arange(n) / n
        # A polygon whose mean radius is the ellipse's.
        grow = 1.0 / np.sinc(1.0 / n)
        circle = grow * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        z, half_x, half_y, offset = self.rings.T
        around = np.empty((k, n, 3))
        around[..., 0] = half_x[:, None] * circle[:, 0] + offset[:, None]
        around[..., 1] = half_y[:, None] * circle[:, 1]
        around[..., 2] = z[:, None]
        poles = np.array([[offset[0], 0.0, z[0]], [offset[-1], 0.0, z[-1]]])
        vertices = self._placed(np.concatenate([around.reshape(-1, 3), poles]))
        i, around_it = np.meshgrid(np.arange(k - 1), np.arange(n), indexing="ij")
        a, b = i * n + around_it, i * n + (around_it + 1) % n
        sides = np.stack([a, b, b + n, a, b + n, a + n], axis=-1).reshape(-1, 3)
        j = np.arange(n)
        low = np.stack([np.full(n, k * n), (j + 1) % n, j], axis=1)
        top = (k - 1) * n
        high = np.stack([np.full(n, k * n + 1), top + j, top + (j + 1) % n], axis=1)
        return vertices, np.concatenate([sides, low, high])

    def solids(self, prefix: str, color: tuple[float, float, float]) -> list[Solid]:
        """Roughly the same of cylinders and spheres, for drawing; in the body part's frame."""
        z, half_x, half_y, offset = self.rings.T
        thin = float(np.median(np.minimum(half_x, half_y)))
        spread = float(np.median(half_y) - thin)
        sides = (-spread, 0.0, spread) if spread > 0.3 * thin else (0.0,)
        middle = float(np.median(offset))
        low, high = z[0] + 0.5 * thin, z[-1] - 0.5 * thin
        found = []
        for i, y in enumerate(sides):
            ends = self._placed(np.array([[middle, y, low], [middle, y, high]]))
            if high - low > 0.5 * thin:
                T = make_pose(self._turned(), ends.mean(axis=0))
                size = (thin, float(high - low), 0.0)
                found.append(Solid(f"{prefix}/{i}", "cylinder", size, T, color))
            for j, end in enumerate(ends):
                T = make_pose(None, end)
                found.append(Solid(f"{prefix}/{i}/{j}", "sphere", (thin, 0.0, 0.0), T, color))
        return found

    def _turned(self) -> Floats:
        return np.eye(3) if self.turn is None else self.turn

    def _placed(self, points: Points) -> Points:
        placed = points @ self._turned().T
        return np.asarray(placed if self.origin is None else placed + self.origin)


def loft(
    name: str,
    look: str,
    rings: Sequence[Sequence[float]],
    *,
    length: float = 1.0,
    width: float = 1.0,
    pieces: int = 1,
    origin: tuple[float, float, float] | None = None,
    turn: Floats | None = None,
    segments: int = 16,
) -> Loft:
    """A loft from rings of (height, half width x[, half width y[, offset x]]).

    Args:
        name: of the piece.
        look: see :class:`Loft`.
        rings: a missing half width y is that of x.
        length: factor of the heights.
        width: factor of widths and offsets.
        pieces: see :class:`Loft`.
        origin: see :class:`Loft`.
        turn: see :class:`Loft`.
        segments: facets around.
    """
    full = [(r[0], r[1], r[2] if len(r) > 2 else r[1], r[3] if len(r) > 3 else 0.0) for r in rings]
    table = np.array(full) * np.array([length, width, width, width])
    place = None if origin is None else np.array(origin)
    return Loft(name, table, look, pieces, turn, place, segments)
