"""Cameras that are carried by the same thing, a stereo pair: one in the other, and how surely.

What the arm does wrong moves what both see alike, because views are shared and each has one error
of the arm: the pair is known better than either camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.geometry.pose import inverse, log


@dataclass(frozen=True)
class Pair:
    """Two cameras in one mount.

    Attributes:
        first, second: indices of the rigs.
        T_first_second: the second in the first.
        covariance: (6, 6) of that (translation [m], rotation [rad], in the second's axes).
    """

    first: int
    second: int
    T_first_second: Pose
    covariance: Floats

    def words(self, names: tuple[str, str]) -> str:
        """One line for people."""
        mm = 1e3 * float(np.linalg.norm(self.T_first_second[:3, 3]))
        turn = float(np.rad2deg(np.linalg.norm(log(self.T_first_second)[3:])))
        sigma = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        x, y, z = 1e3 * self.T_first_second[:3, 3]
        return (
            f"{names[1]} in {names[0]}: x {x:.2f} y {y:.2f} z {z:.2f} mm, {mm:.2f} mm apart, "
            f"turned by {turn:.3f} deg, sigma {1e3 * sigma[:3].max():.2f} mm and "
            f"{np.rad2deg(sigma[3:].max()):.3f} deg"
        )


def pairs(calibration: Calibration) -> list[Pair]:
    """Every two cameras in the same mount."""
    rigs = calibration.problem.rigs
    model = calibration.solution.model
    seen = {model.problem.lenses[s.lens].rig for s in model.problem.sightings}
    out = []
    for a, b in combinations(range(len(rigs)), 2):
        if rigs[a].mount != rigs[b].mount or not {a, b} <= seen:
            continue
        T = inverse(calibration.camera_pose(a)) @ calibration.camera_pose(b)
        at = np.r_[model.rig_slice(a), model.rig_slice(b)]
        D = np.hstack([-se3.adjoints(inverse(T)[None])[0], np.eye(6)])
        out.append(Pair(a, b, T, D @ calibration.covariance.block(at) @ D.T))
    return out
