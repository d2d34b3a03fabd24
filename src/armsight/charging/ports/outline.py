"""The one plane shape that ports are made of: a circle or a slot with round ends, maybe cut flat.

All points within ``radius`` of the segment from (x - spread, y) to (x + spread, y) that are not
above ``flat``: a circle, the D of a Type 2 inlet, the slot of the DC contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Mask


@dataclass(frozen=True)
class Outline:
    """A closed curve in a plane of the port's frame.

    Attributes:
        x, y: centre [m].
        radius: of the round parts [m].
        spread: half the straight part along x; 0 for a circle [m].
        flat: the shape ends at this y [m]; None where it is round all around.
    """

    x: float
    y: float
    radius: float
    spread: float = 0.0
    flat: float | None = None

    def grown(self, by: float) -> Outline:
        """The outline moved outward by a distance [m]; negative moves it inward."""
        flat = None if self.flat is None else self.flat + by
        return replace(self, radius=self.radius + by, flat=flat)

    def contains(self, points: Floats, margin: float = 0.0) -> Mask:
        """Which of (n, 2) points lie inside by more than a margin [m]."""
        dx = np.maximum(np.abs(points[:, 0] - self.x) - self.spread, 0.0)
        inside = np.hypot(dx, points[:, 1] - self.y) < self.radius - margin
        if self.flat is not None:
            inside &= points[:, 1] < self.flat - margin
        return np.asarray(inside)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        return float(sum(n for _, n in self._pieces()))

    def _pieces(self) -> list[tuple[tuple[float, ...], float]]:
        """Lines (x0, y0, x1, y1) and arcs (cx, cy, from, to), anticlockwise, with lengths."""
        r, w = self.radius, self.spread
        cut = r if self.flat is None else self.flat - self.y
        turn = float(np.arccos(np.clip(cut / r, -1.0, 1.0)))  # from the top to where it is cut
        high = 0.5 * np.pi - turn
        pieces: list[tuple[tuple[float, ...], float]] = []
        half = w + r * float(np.sin(turn))
        if half > 0:
            top = self.y + min(cut, r)
            pieces.append(((self.x + half, top, self.x - half, top), 2 * half))
        pieces.append(((self.x - w, self.y, np.pi - high, 1.5 * np.pi), r * (0.5 * np.pi + high)))
        if w > 0:
            pieces.append(((self.x - w, self.y - r, self.x + w, self.y - r), 2 * w))
        pieces.append(((self.x + w, self.y, -0.5 * np.pi, high), r * (0.5 * np.pi + high)))
        return pieces

    def sample(self, step: float) -> tuple[Floats, Floats]:
        """Points along the curve, anticlockwise, about ``step`` [m] apart.

        Returns:
            (n, 2) points [m] and (n, 2) unit normals, outward.
        """
        points, normals = [], []
        for piece, length in self._pieces():
            n = max(1, round(length / step))
            at = (np.arange(n) + 0.5) / n
            if self._is_arc(piece):
                cx, cy, a, b = piece
                angle = a + (b - a) * at
                normal = np.stack([np.cos(angle), np.sin(angle)], 1)
                points.append(np.array([cx, cy]) + self.radius * normal)
            else:
                x0, y0, x1, y1 = piece
                points.append(np.stack([x0 + (x1 - x0) * at, y0 + (y1 - y0) * at], 1))
                normal = np.tile([0.0, 1.0 if x1 < x0 else -1.0], (n, 1))
            normals.append(normal)
        return np.concatenate(points), np.concatenate(normals)

    def _is_arc(self, piece: tuple[float, ...]) -> bool:
        x0, y0 = piece[:2]
        return y0 == self.y and abs(abs(x0 - self.x) - self.spread) < 1e-12


def inside_any(outlines: Sequence[Outline], points: Floats, margin: float = 0.0) -> Mask:
    """Which of (n, 2) points lie inside at least one outline by more than a margin [m]."""
    found = np.zeros(len(points), bool)
    for outline in outlines:
        found |= outline.contains(points, margin)
    return found


def sample_union(outlines: Sequence[Outline], step: float) -> tuple[Floats, Floats]:
    """Points and outward normals of the border of several outlines joined."""
    points, normals = [], []
    for i, outline in enumerate(outlines):
        p, n = outline.sample(step)
        keep = ~inside_any([o for j, o in enumerate(outlines) if j != i], p, 1e-9)
        points.append(p[keep])
        normals.append(n[keep])
    return np.concatenate(points), np.concatenate(normals)
