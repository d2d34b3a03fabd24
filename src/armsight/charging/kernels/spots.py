"""Contacts too small for their rims to be seen: spots that differ from all that is around them."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Mask, SignedShorts
from armsight.charging.kernels.edges import project_lens

AROUND = 8
"""Places about a spot that it is compared with."""
ASIDE = 1
"""How far beside its place a spot may lie, along x and along y [px]."""


@njit(cache=True, nogil=True)
def spots(
    soft: SignedShorts, lens: Floats, pose: Floats, middles: Floats, around: Floats, least: float
) -> Mask:
    """Where a picture shows a spot: a dark hole, or a bright pin in one.

    Args:
        soft: (h, w) grey levels.
        lens: see :func:`project_lens`.
        pose: (4, 4) of the port in the lens's frame, before it.
        middles: (m, 3) where spots should be, in the port's frame [m].
        around: (m,) radius of the circle that each is compared with [m].
        least: differences below this are none [levels].

    Returns:
        (2, m) whether all of that circle is darker than its middle; whether all of it is lighter.
    """
    out = np.zeros((2, len(middles)), np.bool_)
    circle = np.empty((AROUND, 2))
    for k in range(len(middles)):
        u, v = _seen_at(lens, pose, middles[k], 0.0, 0.0)
        for j in range(AROUND):
            angle = 2.0 * np.pi * j / AROUND
            x, y = around[k] * np.cos(angle), around[k] * np.sin(angle)
            circle[j, 0], circle[j, 1] = _seen_at(lens, pose, middles[k], x, y)
        for dv in range(-ASIDE, ASIDE + 1):
            for du in range(-ASIDE, ASIDE + 1):
                middle = _smooth(soft, u + du, v + dv)
                darker, lighter = True, True
                for j in range(AROUND):
                    more = _smooth(soft, circle[j, 0] + du, circle[j, 1] + dv) - middle
                    darker &= more < -least
                    lighter &= more > least
                out[0, k] |= darker
                out[1, k] |= lighter
    return out


@njit(cache=True, nogil=True)
def _seen_at(lens: Floats, T: Floats, p: Floats, x: float, y: float) -> tuple[float, float]:
    """Where a point is seen that lies beside another [px]."""
    a, b, c = p[0] + x, p[1] + y, p[2]
    return project_lens(
        lens,
        T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3],
        T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3],
        T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3],
    )


@njit(cache=True, nogil=True)
def _smooth(soft: SignedShorts, u: float, v: float) -> float:
    """The grey level at the pixel nearest to a place, with its neighbours (1 2 1, both ways)."""
    h, w = soft.shape
    x = min(max(int(np.rint(u)), 1), w - 2)
    y = min(max(int(np.rint(v)), 1), h - 2)
    total = 0.0
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            total += (2 - abs(dx)) * (2 - abs(dy)) * np.float64(soft[y + dy, x + dx])
    return total / 16.0
