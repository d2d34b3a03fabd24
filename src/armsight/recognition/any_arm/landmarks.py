"""Points of an arm that can be told apart in a picture, and the box of each link.

The base's origin, the joint origins, the flange, and the middle of each link's surface. Ends of a
joint's axis are none of them: the two ends of a pitch axis look alike, and networks err three times
as much there. A link's box scales the coordinates that the network gives of its surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints, Points, Poses
from armsight.errors import RecognitionError
from armsight.recognition.own_arm.surface import arm_surface
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class Landmarks:
    """What a network learns to find on an arm of n joints.

    Attributes:
        slot: (p,) place of each in a network's outputs; places mean the same on every arm.
        link: (p,) index of the link that carries each point.
        point: (p, 3) in that link's frame [m].
        middle: (n + 1, 3) middle of each link's surface, in its frame [m].
        half: (n + 1, 3) half the sides of the box about it [m].
    """

    slot: Ints
    link: Ints
    point: Points
    middle: Points
    half: Points

    def placed(self, T_x_link: Poses) -> Points:
        """(p, 3) points in a frame x [m], of (n + 1, 4, 4) poses of the links in it."""
        T = T_x_link[self.link]
        return np.asarray((T[:, :3, :3] @ self.point[:, :, None])[..., 0] + T[:, :3, 3])

    def to_json(self) -> dict[str, list[object]]:
        """Plain lists, for a network's card."""
        return {name: np.round(value, 6).tolist() for name, value in vars(self).items()}


MOST_JOINTS = 8
"""Of an arm that a network has room for."""
SLOTS = 2 * MOST_JOINTS + 3
"""Base, joint 1 to 8, flange, middle of link 0 to 8."""
_FARTHEST = 100.0
"""No arm has a link so long [m]."""
LEAST_HALF = 0.02
"""A link's box is at least this large [m]."""


def find_landmarks(robot: Robot) -> Landmarks:
    """The landmarks of a robot of n joints, from its kinematics and its meshes: 2 n + 3 points.

    Raises:
        RecognitionError: it has too many joints.
    """
    if robot.n > MOST_JOINTS:
        raise RecognitionError(
            f"{robot.name} has {robot.n} joints; the network has room for {MOST_JOINTS}"
        )
    surface = arm_surface(robot)
    slot = [*range(robot.n + 1), MOST_JOINTS + 1]
    link = [0, *range(1, robot.n + 1), robot.n]
    point: list[Floats] = [np.zeros(3)] * (robot.n + 1) + [robot.T_last_flange[:3, 3]]
    middle, half = np.zeros((robot.n + 1, 3)), np.full((robot.n + 1, 3), LEAST_HALF)
    for k in range(robot.n + 1):
        mine = surface.points[surface.owner == k]
        if len(mine):
            low, high = mine.min(axis=0), mine.max(axis=0)
            middle[k], half[k] = 0.5 * (low + high), np.maximum(0.5 * (high - low), LEAST_HALF)
            slot.append(MOST_JOINTS + 2 + k)
            link.append(k)
            point.append(mine.mean(axis=0))
    return Landmarks(
        np.array(slot, np.int64), np.array(link, np.int64), np.array(point), middle, half
    )


def read_landmarks(entry: dict[str, Any]) -> Landmarks:
    """Landmarks of a network's card.

    Raises:
        ValueError, KeyError, TypeError: they are damaged.
    """
    slot, link = (np.array(entry[k], np.int64) for k in ("slot", "link"))
    point, middle, half = (np.array(entry[k], np.float64) for k in ("point", "middle", "half"))
    good = (
        link.ndim == 1
        and 0 < len(link) <= SLOTS
        and slot.shape == link.shape
        and bool(((slot >= 0) & (slot < SLOTS)).all())
        and point.shape == (len(link), 3)
        and middle.ndim == 2
        and middle.shape == half.shape
        and middle.shape[1] == 3
        and bool(((link >= 0) & (link < len(middle))).all())
        and all(bool((np.abs(v) < _FARTHEST).all()) for v in (point, middle, half))  # no NaN
        and bool((half > 0).all())
    )
    if not good:
        raise ValueError
    return Landmarks(slot, link, point, middle, half)
