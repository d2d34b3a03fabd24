"""Two lenses on one bar: the converging pair of the charging paper, and what it triangulates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Points, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy


@dataclass(frozen=True)
class StereoPair:
    """A calibrated pair.

    Attributes:
        left, right: their lenses.
        T_left_right: the right lens in the left one's frame.
    """

    left: PinholeCamera
    right: PinholeCamera
    T_left_right: Pose

    @property
    def baseline(self) -> float:
        """Distance of the lenses [m]."""
        return float(np.linalg.norm(self.T_left_right[:3, 3]))

    @property
    def toe_in(self) -> float:
        """Angle of the right lens inward about the vertical axis [rad]."""
        R = self.T_left_right[:3, :3]
        return float(-np.arctan2(R[0, 2], R[2, 2]))

    def triangulate(self, left: Floats, right: Floats) -> Points:
        """(n, 3) points in the left frame of (n, 2) pixels in both pictures, by least squares.

        The point nearest to both rays; exact for any relative pose, unlike equation 1 of the
        paper (:meth:`triangulate_converging`).
        """
        a = np.column_stack([self.left.normalise(left), np.ones(len(left))])
        b = np.column_stack([self.right.normalise(right), np.ones(len(right))])
        b = b @ self.T_left_right[:3, :3].T
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        b /= np.linalg.norm(b, axis=1, keepdims=True)
        t = self.T_left_right[:3, 3]
        ab = np.einsum("ij,ij->i", a, b)
        det = np.maximum(1.0 - ab * ab, 1e-12)
        s = (a @ t - ab * (b @ t)) / det
        r = (ab * (a @ t) - b @ t) / det
        return np.asarray(0.5 * (a * s[:, None] + b * r[:, None] + t))

    def triangulate_converging(self, left: Floats, right: Floats) -> Points:
        """(n, 3) points in the left frame by equation 1 of the charging paper.

        Z0 = b / tan(toe-in), Z = b f / (x1 - x2 + f b / Z0), X = x1 Z / f, Y = y1 Z / f: the
        disparity of a parallel pair, with that of the axes' crossing added. The sign of the
        added disparity is that of lenses which look inward.
        """
        f, b = self.left.fx, self.baseline
        one = self.left.normalise(left)
        two = self.right.normalise(right)
        Z0 = b / np.tan(self.toe_in)
        disparity = f * (one[:, 0] - two[:, 0]) + f * b / Z0
        Z = b * f / disparity
        return np.column_stack([one[:, 0] * Z, one[:, 1] * Z, Z])


def converging_pair(
    lens: PinholeCamera, baseline: float, toe_in: float, right: PinholeCamera | None = None
) -> StereoPair:
    """Two lenses side by side, the right one turned inward about the vertical axis.

    Args:
        lens: of the left one, and of the right one unless that is given.
        baseline: distance of the lenses [m].
        toe_in: angle between their axes [rad].
        right: lens of the right one.
    """
    T = from_rpy((0.0, -toe_in, 0.0), (baseline, 0.0, 0.0))
    return StereoPair(lens, right or lens, T)
