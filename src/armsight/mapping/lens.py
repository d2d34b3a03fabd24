"""A depth lens in the form that compiled loops read."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Shorts
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.kernels.pooling import (
    CELL,
    LEVELS,
    build_tables,
    gather,
    nearness_of_cells,
    pool,
    to_units,
)

CLOSE = 0.02
"""Nearer than this nothing is projected [m]."""


class DepthLens:
    """Rays of a depth lens, and its images pooled as an ideal lens would see them.

    A lens with distortion is hard to project a voxel through, exactly and quickly. So its image is
    laid out anew for an ideal lens first: each ideal pixel takes the least depth of all real pixels
    that overlap it, which keeps "seen through" conservative.

    Attributes:
        camera: the lens.
        rays: (h, w, 2) float32 x/z, y/z of each pixel.
        ideal: (4,) fx fy cx cy of the ideal lens.
        units: depth units a metre of the tables.
        least: (5, H, W) uint16 pooled tables of the least depth; filled by :meth:`tabulate`.
        nearness: (5, h, w) uint16 the same of the nearness, over squares of CELL ideal pixels.
    """

    def __init__(self, camera: PinholeCamera, far: float) -> None:
        self.camera = camera
        self.rays, self._index, self._window, self.ideal = _geometry(camera)
        self.units = 65000.0 / far
        self._bounds = _bounds(camera)
        h, w = camera.height, camera.width
        H, W = (h, w) if self._index is None else self._index.shape
        self.least: Shorts = np.zeros((LEVELS, H, W), np.uint16)
        self.nearness: Shorts = np.zeros((LEVELS, -(-H // CELL), -(-W // CELL)), np.uint16)
        self._row: Shorts = np.zeros(max(w, W), np.uint16)
        self._raw: Shorts = np.zeros((h, w), np.uint16)

    def tabulate(self, depth: Floats32, label: Bytes) -> None:
        """Fill the pooled tables from an image; pixels labelled 0 count as depth 0."""
        least, nearness = self.least, self.nearness
        if self._index is None:
            to_units(depth, label, self.units, least[0])
        else:
            to_units(depth, label, self.units, self._raw)
            for _ in range(self._window - 1):
                pool(self._raw, 1, self._row[: depth.shape[1]], self._raw)
            gather(self._raw, self._index, least[0])
        row = self._row[: least.shape[2]]
        build_tables(least, row)
        nearness_of_cells(least[0], row, nearness[0])
        build_tables(nearness, row[: nearness.shape[2]])

    def rectangles(self, corners: Floats) -> Ints:
        """(m, 4) first and last column, first and last row that can see each of m boxes.

        Args:
            corners: (m, 8, 3) corners of the boxes in the camera frame [m].
        """
        depth = corners[..., 2]
        flat = corners[..., :2] / np.maximum(depth, CLOSE)[..., None]
        low, high = flat.min(axis=1), flat.max(axis=1)
        out = np.empty((len(corners), 4), np.int64)
        for axis, (least, greatest) in enumerate(self._bounds):
            out[:, 2 * axis] = np.searchsorted(greatest, low[:, axis])
            out[:, 2 * axis + 1] = np.searchsorted(least, high[:, axis], side="right") - 1
        # What reaches behind the lens may be anywhere in the picture, what is behind it nowhere.
        out[depth.min(axis=1) <= CLOSE] = (0, self.camera.width - 1, 0, self.camera.height - 1)
        out[depth.max(axis=1) <= CLOSE] = (0, -1, 0, -1)
        return out


@lru_cache(maxsize=16)
def _bounds(camera: PinholeCamera) -> tuple[Floats, Floats]:
    """Least and greatest x/z of every column and y/z of every row, made monotonic: (2, w), (2, h).

    ``[0]`` is the least value in this or any later line, ``[1]`` the greatest in this or any
    earlier one, so that a search in either is conservative.
    """
    rays = camera.rays
    sides = []
    for axis in (0, 1):
        line = rays[..., axis]
        least = np.minimum.accumulate(line.min(axis=axis)[::-1])[::-1]
        greatest = np.maximum.accumulate(line.max(axis=axis))
        sides.append(np.stack([least, greatest]))
    return sides[0], sides[1]


@lru_cache(maxsize=16)
def _geometry(camera: PinholeCamera) -> tuple[Floats32, Ints32 | None, int, Floats]:
    """Rays; index of the window under each ideal pixel; window size [px]; the ideal lens.

    The index is None for a lens that is ideal itself.
    """
    rays = np.ascontiguousarray(camera.rays, np.float32)
    if camera.is_ideal:
        return rays, None, 1, np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    low = rays.reshape(-1, 2).min(axis=0).astype(float)
    high = rays.reshape(-1, 2).max(axis=0).astype(float)
    ideal = np.array([camera.fx, camera.fy, -low[0] * camera.fx, -low[1] * camera.fy])
    W = int(np.ceil((high[0] - low[0]) * camera.fx)) + 1
    H = int(np.ceil((high[1] - low[1]) * camera.fy)) + 1
    first, last = _overlapped(camera, ideal, W, H)
    inside = (first >= 0).all(-1) & (last[..., 0] < camera.width) & (last[..., 1] < camera.height)
    window = int((last - first)[inside].max()) + 1 if inside.any() else 1
    index = np.where(inside, first[..., 1] * camera.width + first[..., 0], -1)
    return rays, np.ascontiguousarray(index, np.int32), window, ideal


def _overlapped(camera: PinholeCamera, ideal: Floats, W: int, H: int) -> tuple[Ints, Ints]:
    """First and last (column, row) of the real pixels that each ideal pixel overlaps."""
    steps = (-0.5, 0.0, 0.5)
    first = np.full((H, W, 2), np.inf)
    last = np.full((H, W, 2), -np.inf)
    for dv in steps:
        for du in steps:
            v, u = np.mgrid[0:H, 0:W].astype(float)
            x = (u + du - ideal[2]) / ideal[0]
            y = (v + dv - ideal[3]) / ideal[1]
            flat = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
            pixel = camera.project(flat).reshape(H, W, 2)
            first = np.minimum(first, pixel)
            last = np.maximum(last, pixel)
    # Where the polynomial has folded back, ideal neighbours no longer map to neighbours.
    folded = (last - first).max(axis=-1) > 4.0
    u, v = np.meshgrid(np.arange(W), np.arange(H))
    center = camera.project(
        np.stack(
            [
                ((u - ideal[2]) / ideal[0]).ravel(),
                ((v - ideal[3]) / ideal[1]).ravel(),
                np.ones(u.size),
            ],
            axis=1,
        )
    )
    back = camera.normalise(np.clip(np.nan_to_num(center), -1e3, 1e4)).reshape(H, W, 2)
    error = np.abs(back - np.stack([(u - ideal[2]) / ideal[0], (v - ideal[3]) / ideal[1]], -1))
    folded |= error.max(axis=-1) * ideal[0] > 0.5
    first = np.floor(first + 0.5 + 1e-6)
    last = np.floor(last + 0.5 - 1e-6)
    first[folded] = -1
    return first.astype(np.int64), last.astype(np.int64)
