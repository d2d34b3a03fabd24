"""The pinhole camera with Brown-Conrady distortion, in OpenCV's convention.

Pixel centres are at whole numbers counted from 0: an ideal image of width w has cx = (w - 1) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from armsight.arrays import DepthImage, Floats, Points


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics of one lens.

    Attributes:
        width, height: image size [px].
        fx, fy, cx, cy: focal lengths and principal point [px].
        distortion: k1, k2, p1, p2, k3 (OpenCV's order), all zero for an ideal lens.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @classmethod
    def from_fov(cls, width: int, height: int, horizontal: float, vertical: float) -> PinholeCamera:
        """Ideal camera from its fields of view [rad], principal point in the middle."""
        return cls(
            width,
            height,
            0.5 * width / np.tan(0.5 * horizontal),
            0.5 * height / np.tan(0.5 * vertical),
            0.5 * (width - 1),
            0.5 * (height - 1),
        )

    @property
    def K(self) -> Floats:
        """(3, 3) camera matrix [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_ideal(self) -> bool:
        """Whether the lens has no distortion."""
        return not any(self.distortion)

    @cached_property
    def rays(self) -> Floats:
        """(h, w, 2) normalised coordinates x/z, y/z of each pixel's ray, distortion removed."""
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        return self.normalise(np.stack([u, v], -1).reshape(-1, 2)).reshape(
            self.height, self.width, 2
        )

    def normalise(self, pixels: Floats) -> Floats:
        """(n, 2) normalised coordinates of (n, 2) pixels, distortion removed."""
        if self.is_ideal:
            return (np.asarray(pixels, float) - [self.cx, self.cy]) / [self.fx, self.fy]
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
        out = cv2.undistortPointsIter(
            np.ascontiguousarray(pixels, np.float64).reshape(-1, 1, 2),
            self.K,
            np.array(self.distortion),
            np.eye(3),
            np.eye(3),
            criteria,
        )
        return np.asarray(out, np.float64).reshape(-1, 2)

    def project(self, points: Points) -> Floats:
        """(n, 2) pixels of (n, 3) points in the camera frame; NaN for points not in front."""
        p = np.asarray(points, np.float64).reshape(-1, 3)
        front = p[:, 2] > 1e-9
        z = np.where(front, p[:, 2], 1.0)
        x, y = p[:, 0] / z, p[:, 1] / z
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        pixels = np.stack([self.fx * xd + self.cx, self.fy * yd + self.cy], axis=1)
        pixels[~front] = np.nan
        return pixels

    def deproject(self, depth: DepthImage) -> Points:
        """(h, w, 3) points [m] in the camera frame; NaN where depth is NaN."""
        z = np.asarray(depth)[..., None]
        return np.concatenate([self.rays.astype(z.dtype) * z, z], axis=-1)

    def window(self, top: int, bottom: int, left: int, right: int) -> PinholeCamera:
        """The same lens for the rows and columns of such a part of its pictures [px]."""
        return replace(
            self, width=right - left, height=bottom - top, cx=self.cx - left, cy=self.cy - top
        )

    def scaled(self, factor: float) -> PinholeCamera:
        """The same lens at another resolution (pixel centres stay where they belong)."""
        return PinholeCamera(
            round(self.width * factor),
            round(self.height * factor),
            self.fx * factor,
            self.fy * factor,
            (self.cx + 0.5) * factor - 0.5,
            (self.cy + 0.5) * factor - 0.5,
            self.distortion,
        )
