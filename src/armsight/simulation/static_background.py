"""What never moves, drawn once for each fixed camera; afterwards only what moves is drawn.

Floor, walls and tables fill most of a depth picture, and a renderer without a GPU pays for every
pixel. A fixed camera keeps their buffers, and each exposure draws the rest into the rectangle that
it can reach. Merged, the buffers are those of one pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats32, Points, Pose
from armsight.geometry.camera import PinholeCamera

Window = tuple[int, int, int, int]
"""First line, end line, first column, end column of a part of a picture; lines from the top."""


@dataclass(frozen=True)
class Buffers:
    """What OpenGL drew, in its own layout: rows run bottom up.

    Attributes:
        ids: (H, W) segmentation codes, 0 for nothing.
        raw: (H, W) reversed depth buffer, 1 near, 0 far.
        geom_of_id: geom index of each code.
    """

    ids: NDArray[np.uint32]
    raw: Floats32
    geom_of_id: NDArray[np.int16]


def reach_of_spheres(
    centers: Points, radii: Floats32, T_world_camera: Pose, lens: PinholeCamera, margin: int = 3
) -> Window:
    """The part of an ideal lens's picture outside which no sphere can be seen.

    Args:
        centers: (n, 3) in world [m].
        radii: (n,) [m].
        T_world_camera: optical pose.
        lens: without distortion.
        margin: pixels added on every side.

    Returns:
        The window, empty (0, 0, 0, 0) where nothing is in view.
    """
    p = (centers - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    ahead = p[:, 2] > -radii
    x, y, z, r = p[ahead, 0], p[ahead, 1], p[ahead, 2], radii[ahead]
    if not len(z):
        return 0, 0, 0, 0
    u0, u1 = _extent(x, z, r, lens.fx, lens.cx, lens.width)
    v0, v1 = _extent(y, z, r, lens.fy, lens.cy, lens.height)
    inside = (u1 > -margin) & (u0 < lens.width + margin) & (v1 > -margin)
    inside &= v0 < lens.height + margin
    if not inside.any():
        return 0, 0, 0, 0
    return (
        max(int(np.floor(v0[inside].min())) - margin, 0),
        min(int(np.ceil(v1[inside].max())) + margin + 1, lens.height),
        max(int(np.floor(u0[inside].min())) - margin, 0),
        min(int(np.ceil(u1[inside].max())) + margin + 1, lens.width),
    )


def _extent(
    across: Floats32, z: Floats32, r: Floats32, focal: float, center: float, size: int
) -> tuple[Floats32, Floats32]:
    """Least and greatest pixel of circles in a plane through the lens; all, where one is near."""
    distance = np.hypot(across, z)
    around = r >= 0.999 * distance
    half = np.arcsin(np.where(around, 0.0, r / np.maximum(distance, 1e-9)))
    middle = np.arctan2(across, z)
    low, high = middle - half, middle + half
    edge = 0.49 * np.pi
    first = np.where(low > -edge, focal * np.tan(np.clip(low, -edge, edge)) + center, -1e6)
    last = np.where(high < edge, focal * np.tan(np.clip(high, -edge, edge)) + center, 1e6)
    return np.where(around, -1e6, first), np.where(around, 1e6, last)
