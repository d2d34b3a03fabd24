"""Hands of recorded people as paths of a target, and who holds it.

The hand relative to the pelvis: the person stands (design/servoing.md, section 6). A stretch of a
clip is played, mirrored or not and turned about the vertical, then slows down and rests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path as FilePath

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.experiments.forecast_clips import find_clips
from armsight.experiments.servo_eyes import Path
from armsight.geometry.pose import from_rpy
from armsight.simulation.clips import load_clip
from armsight.simulation.skeleton import INDEX, MIRRORED

FOLDERS = ("HumanRobotHandover", "PickPlaceCloseHuman")
"""Of the recorded work, what people hand over, and what they do with their hands beside a robot."""
PLAYS, SLOWS = 6.0, 0.5
"""So much of a clip is played, and then it slows down in so long [s]."""
HAND = "right_hand"


@dataclass(frozen=True)
class RecordedHand:
    """Someone who stands and moves a hand, in axes of ``world`` about the hand's mean place.

    Attributes:
        name: of the clip, and where in it the stretch begins.
        rate: samples a second [Hz].
        joints: (k, 19, 3) [m]; what the hand holds is in the right one.
    """

    name: str
    rate: float
    joints: Floats

    def at(self, time: float) -> Points:
        """(19, 3) joints at a time [s]: as recorded, slower and slower, at rest."""
        over = min(max(time - PLAYS, 0.0), SLOWS)
        played = min(time, PLAYS) + over - 0.5 * over * over / SLOWS
        place = min(max(played * self.rate, 0.0), len(self.joints) - 1.0)
        before = min(int(place), len(self.joints) - 2)
        share = place - before
        return np.asarray((1.0 - share) * self.joints[before] + share * self.joints[before + 1])

    def hand(self, time: float) -> Vector3:
        """(3,) the hand at a time [s]."""
        return np.asarray(self.at(time)[INDEX[HAND]])

    @property
    def fastest(self) -> float:
        """Greatest speed of the hand [m/s]."""
        track = np.diff(self.joints[:, INDEX[HAND]], axis=0) * self.rate
        return float(np.linalg.norm(track, axis=1).max())


def recorded_hand(rng: np.random.Generator, turned: float = math.pi) -> RecordedHand:
    """A stretch of a clip by chance.

    Args:
        rng: draws clip, stretch, mirroring and turn.
        turned: about the vertical by up to this much [rad].

    Raises:
        ArmsightError: the recordings are not there.
    """
    paths = [path for path in find_clips() if path.parent.name in FOLDERS]
    path = paths[int(rng.integers(len(paths)))]
    name, rate, joints = _standing(path)
    count = min(round((PLAYS + SLOWS) * rate), len(joints))
    first = int(rng.integers(len(joints) - count + 1))
    joints = joints[first : first + count]
    if rng.random() < 0.5:
        joints = joints[:, MIRRORED] * (1.0, -1.0, 1.0)
    R = from_rpy((0.0, 0.0, rng.uniform(-turned, turned)))[:3, :3]
    joints = (joints - joints[:, INDEX[HAND]].mean(axis=0)) @ R.T
    return RecordedHand(f"{name} from {first / rate:.1f} s", rate, joints)


def recorded_path(
    place: Vector3, T_world_base: Pose, rng: np.random.Generator, rests: bool = False
) -> tuple[Path, str, float]:
    """The path of a recorded hand, its clip, greatest speed [m/s].

    Args:
        place: (3,) its mean in ``base`` [m], or where it comes to rest.
        T_world_base: of the arm.
        rng: draws the stretch.
        rests: the place is where it comes to rest.
    """
    found, R = recorded_hand(rng), np.asarray(T_world_base)[:3, :3].T
    start = place - R @ found.hand(math.inf) if rests else place
    return lambda time: start + R @ found.hand(time), found.name, found.fastest


@cache
def _standing(path: FilePath) -> tuple[str, float, Floats]:
    """Name, rate [Hz] and (k, 19, 3) joints of a clip about its pelvis [m]."""
    clip = load_clip(path)
    joints = clip.joints - clip.joints[:, [INDEX["pelvis"]]]
    return clip.name, clip.rate, np.asarray(joints)
