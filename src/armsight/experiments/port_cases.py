"""What the experiments on ports share: the situations, and how a pose is scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.find import INLETS
from armsight.experiments.port_scene import PortView, random_view
from armsight.geometry.pose import inverse, log

TYPES = (*INLETS, "type2_plug")
"""What is shown to the detector."""


def port_views(count: int, seed: int) -> list[PortView]:
    """Ports anywhere to 2.5 m and 45 deg, in any light."""
    rng = np.random.default_rng((seed, 1))
    return [random_view(rng, TYPES, (0.3, 2.5)) for _ in range(count)]


def empty_views(count: int, seed: int) -> list[PortView]:
    """Walls with boxes, cups, washers, wheels, vents, knobs and sockets, and no port."""
    rng = np.random.default_rng((seed, 2))
    return [random_view(rng, (), (0.5, 2.0)) for _ in range(count)]


def near_views(count: int, seed: int, key: int = 3) -> list[PortView]:
    """Inlets at 0.3 to 0.5 m, to 45 deg."""
    rng = np.random.default_rng((seed, key))
    return [random_view(rng, INLETS, (0.3, 0.5), aim=0.15) for _ in range(count)]


def far_views(count: int, seed: int) -> list[PortView]:
    """Inlets at 1 m, 20 to 30 deg off axis."""
    rng = np.random.default_rng((seed, 4))
    return [random_view(rng, INLETS, (0.99, 1.01), (20.0, 30.0), aim=0.3) for _ in range(count)]


@dataclass(frozen=True)
class PoseError:
    """How far a pose is off, in the port's frame.

    Attributes:
        lateral, depth: [m]; depth is along the port's axis.
        tilt, roll: [rad].
        inside: whether the truth lies in the stated 95 % ellipsoid.
    """

    lateral: float
    depth: float
    tilt: float
    roll: float
    inside: bool


CHI2_6_95 = 12.592
"""95 % of chi squared with six degrees of freedom."""


def pose_error(truth: Pose, found: Pose, covariance: Floats | None = None) -> PoseError:
    """Score a pose against the truth."""
    e = log(inverse(truth) @ found)
    inside = False
    if covariance is not None:
        inside = bool(e @ np.linalg.solve(covariance, e) <= CHI2_6_95)
    tilt = float(np.arccos(np.clip(truth[:3, 2] @ found[:3, 2], -1.0, 1.0)))
    return PoseError(float(np.hypot(e[0], e[1])), float(abs(e[2])), tilt, float(abs(e[5])), inside)
