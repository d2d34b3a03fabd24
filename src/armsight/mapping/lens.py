"""A depth lens in the form that compiled loops read."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Floats32, Ints
from armsight.geometry.camera import PinholeCamera


class Lens:
    """Rays and projection of a depth lens.

    Attributes:
        camera: the lens.
        rays: (h, w, 2) float32 x/z, y/z of each pixel.
        vector: (11,) fx fy cx cy k1 k2 p1 p2 k3 and the greatest |x/z|, |y/z| in the image.
    """

    def __init__(self, camera: PinholeCamera) -> None:
        self.camera = camera
        self.rays: Floats32 = np.ascontiguousarray(camera.rays, np.float32)
        extent = 1.05 * np.abs(self.rays).reshape(-1, 2).max(axis=0).astype(float)
        self.vector: Floats = np.array(
            [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion, *extent]
        )

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
                continue
            if box[:, 2].min() <= 0.02:
                out[m] = (0, w - 1, 0, h - 1)
                continue
            low, high = (box[:, :2] / box[:, 2:]).min(axis=0), (box[:, :2] / box[:, 2:]).max(axis=0)
            out[m] = self._pixels(low, high)
        return out

    def _pixels(self, low: Floats, high: Floats) -> tuple[int, int, int, int]:
        limit = self.vector[9:]
        low, high = np.maximum(low, -limit), np.minimum(high, limit)
        if (low >= high).any():
            return (0, -1, 0, -1)
        sides = np.linspace(0.0, 1.0, 5)
        x = low[0] + sides * (high[0] - low[0])
        y = low[1] + sides * (high[1] - low[1])
        gx, gy = np.meshgrid(x, y)
        uv = self.camera.project(np.stack([gx.ravel(), gy.ravel(), np.ones(gx.size)], axis=1))
        pad = 0 if self.camera.is_ideal else 3
        u0, v0 = np.floor(uv.min(axis=0)).astype(int) - pad
        u1, v1 = np.ceil(uv.max(axis=0)).astype(int) + pad
        w, h = self.camera.width, self.camera.height
        return (max(int(u0), 0), min(int(u1), w - 1), max(int(v0), 0), min(int(v1), h - 1))
