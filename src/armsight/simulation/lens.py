"""How a distorted lens is rendered: through an ideal pinhole a little wider, then remapped."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armsight.arrays import Floats32
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class RenderLens:
    """An ideal pinhole that sees all that a lens sees, and where each of the lens's pixels falls.

    Attributes:
        lens: the lens asked for.
        pinhole: ideal, of the same focal lengths, at least as wide.
        map_u, map_v: (h, w) column and row in the pinhole's image of each pixel of the lens [px].
        exact: whether both images are the same.
    """

    lens: PinholeCamera
    pinhole: PinholeCamera
    map_u: Floats32
    map_v: Floats32
    exact: bool


@lru_cache(maxsize=64)
def render_lens(lens: PinholeCamera) -> RenderLens:
    """The table for a lens; computed once."""
    if lens.is_ideal:
        v, u = np.mgrid[0 : lens.height, 0 : lens.width].astype(np.float32)
        return RenderLens(lens, lens, u, v, True)
    rays = lens.rays
    u = rays[..., 0] * lens.fx
    v = rays[..., 1] * lens.fy
    left, top = np.floor(u.min()) - 1.0, np.floor(v.min()) - 1.0
    pinhole = PinholeCamera(
        int(np.ceil(u.max()) + 1.0 - left) + 1,
        int(np.ceil(v.max()) + 1.0 - top) + 1,
        lens.fx,
        lens.fy,
        -left,
        -top,
    )
    return RenderLens(
        lens, pinhole, (u - left).astype(np.float32), (v - top).astype(np.float32), False
    )
