"""How far whoever carries the camera is from what an arm in the picture can reach.

The papers' body-worn use: a person with a camera on comes near an arm, and one picture has to tell.
An arm that is taken for its bigger brother is seen farther away by as much as it reaches farther,
so that this says more than the pose does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.robots.catalogue import load_robot

if TYPE_CHECKING:
    from armsight.recognition.any_arm.sighting import Arm, Sighting

LEAST_TRUST = 0.2
"""Of a pose, below which it says nothing of the distance."""
UNSURE = 0.2
"""Standard deviation of the distance of a pose that is not believed [m]: of 150 tuning frames
(Mitsuba's) such poses put the camera 0.08 m off in the median, one in ten 0.4 m too far away."""
DEVIATIONS = 2.0
"""Who is nearer than so many may be within."""


@dataclass(frozen=True)
class Reach:
    """Where a camera is, seen from what an arm's flange can reach; a tool reaches farther.

    Attributes:
        distance: from the ball about the shoulder beyond which no joint angles put the flange [m],
            negative within; NaN where nothing is known of it.
        sigma: its standard deviation [m].
    """

    distance: float
    sigma: float

    @property
    def least(self) -> float:
        """What the distance is at least, as far as one can say [m]; NaN where one cannot."""
        return self.distance - DEVIATIONS * self.sigma

    @property
    def may_be_within(self) -> bool:
        """Whether the camera may be within: also where nothing is known."""
        return not self.least > 0.0

    def words(self) -> str:
        """In short."""
        if np.isnan(self.distance):
            return "you may be within its reach"
        if not self.may_be_within:
            return f"its reach ends {self.distance:.2f} m before you"
        within = self.distance < 0.0
        return "you are within its reach" if within else "you may be within its reach"

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        known = not np.isnan(self.distance)
        return {
            "distance_m": round(self.distance, 3) if known else None,
            "sigma_m": round(self.sigma, 3) if known else None,
            "may_be_within": self.may_be_within,
        }


UNKNOWN = Reach(float("nan"), float("nan"))


def reach_of(arm: Arm) -> Reach:
    """How far the camera is from an arm's reach, by the arm's pose in the picture."""
    if arm.T_camera_base is None or arm.trust < LEAST_TRUST or len(arm.joints) < 2:
        return UNKNOWN
    shoulder, C = arm.joints[1], arm.covariance[1]
    away = float(np.linalg.norm(shoulder))
    ray = shoulder / max(away, 1e-9)
    sigma = float(np.sqrt(max(ray @ C @ ray, 0.0)))
    if not arm.believed:
        sigma = float(np.hypot(sigma, UNSURE))
    radius = max(load_robot(name).stretched for name in (arm.robot, *arm.alike))
    return Reach(away - radius, sigma)


def warning_of(found: Sighting) -> str:
    """What whoever carries the camera should hear of the arms in a picture; empty if nothing."""
    near = [f"{arm.robot}: {r.words()}" for arm in found.arms if (r := reach_of(arm)).may_be_within]
    return "; ".join(near)
