"""How a distorted lens is rendered: through an ideal pinhole a little wider, then remapped."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats32, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.simulation.static_background import Window


@dataclass(frozen=True)
class RenderLens:
    """An ideal pinhole that sees all that a lens sees, and where each of the lens's pixels falls.

    Attributes:
        lens: the lens asked for.
        pinhole: ideal, of the same focal lengths, a little wider.
        map_u: (h, w) column in the pinhole's image of each pixel of the lens [px].
        map_v: (h, w) its line [px].
        corner: (h, w) the pixel above and left of that, as an index into a flat bottom-up buffer.
        weight_u: (h, w) share of the pixel to the right.
        weight_v: (h, w) share of the pixel below.
    """

    lens: PinholeCamera
    pinhole: PinholeCamera
    map_u: Floats32
    map_v: Floats32
    corner: NDArray[np.int32]
    weight_u: Floats32
    weight_v: Floats32

    def window_of(self, reach: Window) -> Window:
        """Lines and columns of the lens's picture that a part of the pinhole's can touch."""
        lines, columns = self._spans
        top, bottom = _touched(lines, reach[0] - 1, reach[1])
        left, right = _touched(columns, reach[2] - 1, reach[3])
        return top, bottom, left, right

    @cached_property
    def _spans(self) -> tuple[Floats32, Floats32]:
        """(2, h) least and greatest line in the pinhole's image of each line; (2, w) columns."""
        lines = np.stack([self.map_v.min(axis=1), self.map_v.max(axis=1)])
        columns = np.stack([self.map_u.min(axis=0), self.map_u.max(axis=0)])
        return lines, columns


def _touched(spans: Floats32, first: int, end: int) -> tuple[int, int]:
    """First and end of those whose span meets [first, end]."""
    found = np.flatnonzero((spans[1] >= first) & (spans[0] <= end))
    return (int(found[0]), int(found[-1]) + 1) if len(found) else (0, 0)


@lru_cache(maxsize=64)
def render_lens(lens: PinholeCamera) -> RenderLens:
    """The tables for a lens; computed once."""
    rays = lens.rays
    u = rays[..., 0] * lens.fx
    v = rays[..., 1] * lens.fy
    if lens.is_ideal:  # whole pixels, whatever the principal point
        left, top = -lens.cx - 1.0, -lens.cy - 1.0
    else:
        left, top = np.floor(u.min()) - 1.0, np.floor(v.min()) - 1.0
    width = int(np.floor(u.max() - left + 1e-6)) + 3
    height = int(np.floor(v.max() - top + 1e-6)) + 3
    pinhole = PinholeCamera(width, height, lens.fx, lens.fy, -left, -top)
    map_u, map_v = u - left, v - top
    column, line = np.floor(map_u + 1e-6), np.floor(map_v + 1e-6)
    corner = (height - 1 - line) * width + column
    return RenderLens(
        lens,
        pinhole,
        map_u.astype(np.float32),
        map_v.astype(np.float32),
        np.ascontiguousarray(corner, np.int32),
        np.maximum(map_u - column, 0.0).astype(np.float32),
        np.maximum(map_v - line, 0.0).astype(np.float32),
    )


def aim_scene(
    scene: Any, T_world_camera: Pose, pinhole: PinholeCamera, near: float, far: float
) -> None:
    """Point both cameras of a MuJoCo scene so that they see what an ideal lens does.

    Args:
        scene: an ``MjvScene``.
        T_world_camera: optical pose.
        pinhole: lens without distortion.
        near: what is nearer is not seen [m].
        far: nor what is farther [m].
    """
    left = (-0.5 - pinhole.cx) / pinhole.fx
    right = (pinhole.width - 0.5 - pinhole.cx) / pinhole.fx
    top = (pinhole.cy + 0.5) / pinhole.fy
    bottom = (pinhole.cy + 0.5 - pinhole.height) / pinhole.fy
    for camera in scene.camera:
        camera.pos[:] = T_world_camera[:3, 3]
        camera.forward[:] = T_world_camera[:3, 2]
        camera.up[:] = -T_world_camera[:3, 1]
        camera.frustum_near, camera.frustum_far = near, far
        camera.frustum_center = 0.5 * (left + right) * near
        camera.frustum_width = 0.5 * (right - left) * near
        camera.frustum_bottom, camera.frustum_top = bottom * near, top * near
