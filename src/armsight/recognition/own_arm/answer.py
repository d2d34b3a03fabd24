"""What goes in and comes out: views of the arm, and a camera's pose that judges itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import ColorImage, DepthImage, Floats, JointVector, Points, Pose
from armsight.geometry.pose import skew, transform


@dataclass(frozen=True)
class DepthView:
    """The arm before a depth camera at one instant.

    Attributes:
        joints: (n,) at the exposure [rad].
        depth: (h, w) [m], NaN where nothing is read.
    """

    joints: JointVector
    depth: DepthImage


@dataclass(frozen=True)
class ColorView:
    """The arm before a colour camera at one instant.

    Attributes:
        joints: (n,) at the exposure [rad].
        color: (h, w, 3) RGB.
    """

    joints: JointVector
    color: ColorImage


@dataclass(frozen=True)
class OwnArmPose:
    """A camera's pose by what it saw of the arm.

    Attributes:
        T_base_camera: the lens in ``base``: the best that was found, believed or not.
        covariance: (6, 6) of a twist (translation [m], rotation [rad]) in the camera's frame,
            applied on the left of ``T_camera_base``.
        sigma: standard deviation of where the camera places points of the arm [m]: root mean square
            over them.
        score: of what the pictures say of the answer, what speaks for it less what speaks against
            it, -1..1. seen: share of the arm that they confirm.
        bias: what the depth readings were found to be too long [m]; 0 for colour.
        frames: pictures that it rests on.
        problem: why it is not to be believed, empty where it is.
    """

    T_base_camera: Pose
    covariance: Floats
    sigma: float
    score: float
    seen: float
    bias: float
    frames: int
    problem: str = ""

    @property
    def believed(self) -> bool:
        """Whether it passed the check of itself."""
        return not self.problem


def spread(covariance: Floats, T_camera_base: Pose, points: Points) -> float:
    """Root mean square standard deviation of (n, 3) points in ``base``, in the camera's frame [m].

    Args:
        covariance: see :attr:`OwnArmPose.covariance`.
        T_camera_base: the camera.
        points: in ``base`` [m].
    """
    total = 0.0
    p = transform(T_camera_base, points)
    for point in p:
        J = np.hstack([np.eye(3), -skew(point)])
        total += float(np.trace(J @ covariance @ J.T))
    return float(np.sqrt(total / len(p)))
