"""A depth lens in the form that compiled loops read."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Shorts
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.kernels.pooling import LEVELS, build_tables, gather, pool, to_units


class DepthLens:
    """Rays of a depth lens, and its images pooled as an ideal lens would see them.

    A lens with distortion is hard to project a voxel through, exactly and quickly. So its image is
    laid out anew for an ideal lens first: each ideal pixel takes the least (and the greatest) depth
    of all real pixels that overlap it, which keeps "seen through" conservative.

    Attributes:
        camera: the lens.
        rays: (h, w, 2) float32 x/z, y/z of each pixel.
        ideal: (4,) fx fy cx cy of the ideal lens.
        units: depth units a metre of the tables.
        least, most: (5, H, W) uint16 pooled tables; filled by :meth:`tabulate`.
    """

    def __init__(self, camera: PinholeCamera, far: float) -> None:
        self.camera = camera
        self.rays, self._index, self._window, self.ideal = _geometry(camera)
        self.units = 65000.0 / far
        h, w = camera.height, camera.width
        H, W = (h, w) if self._index is None else self._index.shape
        self.least: Shorts = np.zeros((LEVELS, H, W), np.uint16)
        self.most: Shorts = np.zeros((LEVELS, H, W), np.uint16)
        self._row: Shorts = np.zeros(max(w, W), np.uint16)
        self._raw: Shorts = np.zeros((h, w), np.uint16)
        self._pooled: Shorts = np.zeros((2, h, w), np.uint16)

    def tabulate(self, depth: Floats32, label: Bytes) -> None:
        """Fill the pooled tables from an image; pixels labelled 0 count as depth 0."""
        if self._index is None:
            to_units(depth, label, self.units, self.least[0])
            self.most[0] = self.least[0]
        else:
            to_units(depth, label, self.units, self._raw)
            row = self._row[: depth.shape[1]]
            for k, (least, table) in enumerate(((True, self.least), (False, self.most))):
                source = self._raw
                for _ in range(self._window - 1):
                    pool(source, 1, least, row, self._pooled[k])
                    source = self._pooled[k]
                gather(self._pooled[k], self._index, table[0])
        build_tables(self.least, self.most, self._row[: self.least.shape[2]])

    def rectangles(self, corners: Floats) -> Ints:
        """(m, 4) first and last column, first and last row that can see each of m boxes.

        Args:
            corners: (m, 8, 3) corners of the boxes in the camera frame [m].
        """
        w, h = self.camera.width, self.camera.height
        out = np.empty((len(corners), 4), np.int64)
        for m, box in enumerate(corners):
            if box[:, 2].max() <= 0.02:
                out[m] = (0, -1, 0, -1)
            elif box[:, 2].min() <= 0.02:
                out[m] = (0, w - 1, 0, h - 1)
            else:
                flat = box[:, :2] / box[:, 2:]
                out[m] = self._pixels(flat.min(axis=0), flat.max(axis=0))
        return out

    def _pixels(self, low: Floats, high: Floats) -> tuple[int, int, int, int]:
        """Columns and rows between normalised coordinates."""
        columns, rows = _bounds(self.camera)
        u0 = int(np.searchsorted(columns[1], low[0]))
        u1 = int(np.searchsorted(columns[0], high[0], side="right")) - 1
        v0 = int(np.searchsorted(rows[1], low[1]))
        v1 = int(np.searchsorted(rows[0], high[1], side="right")) - 1
        return u0, u1, v0, v1


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
