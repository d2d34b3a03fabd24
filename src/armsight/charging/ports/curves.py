"""The edges of a port as points in space: what a pose is fitted to, and what a template is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.charging.ports.outline import sample_union
from armsight.charging.ports.table import Port, Rim


@dataclass(frozen=True)
class Curves:
    """Points along the edges.

    Attributes:
        points: (n, 3) in the port's frame [m].
        normals: (n, 3) outward, in the plane of the edge, across it.
        side: (n,) how a point moves along x when its slot's straight part grows: -1..1, 0 on what
            is round.
        rim: (n,) index of each point's edge in ``rims``.
        rims: the edges.
    """

    points: Floats
    normals: Floats
    side: Floats
    rim: Ints
    rims: tuple[Rim, ...]


@lru_cache(maxsize=64)
def curves(port: Port, step: float, fit_only: bool = True) -> Curves:
    """Points about ``step`` [m] apart along a port's edges, mouths joined where they overlap."""
    rims = tuple(rim for rim in port.rims if rim.fit or not fit_only)
    mouths = [rim for rim in port.rims if rim.kind == "mouth"]
    points, normals, sides, index = [], [], [], []
    for i, rim in enumerate(rims):
        p, n = rim.outline.sample(step)
        if rim.kind == "mouth":
            joined, joined_normals = sample_union([m.outline for m in mouths], step)
            on = _on_curve(joined, p, 0.25 * step)
            p, n = joined[on], joined_normals[on]
        points.append(np.column_stack([p, np.full(len(p), rim.z)]))
        normals.append(np.column_stack([n, np.zeros(len(p))]))
        spread = rim.outline.spread
        far = (p[:, 0] - rim.outline.x) / spread if spread else np.zeros(len(p))
        sides.append(np.clip(far, -1.0, 1.0))
        index.append(np.full(len(p), i))
    return Curves(
        np.concatenate(points),
        np.concatenate(normals),
        np.concatenate(sides),
        np.concatenate(index).astype(np.int64),
        rims,
    )


def _on_curve(points: Floats, curve: Floats, within: float) -> Floats:
    """Which (n, 2) points are points of a sampled curve."""
    gap = np.linalg.norm(points[:, None] - curve[None], axis=-1).min(axis=1)
    return np.asarray(gap < within)
