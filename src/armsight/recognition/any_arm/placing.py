"""Where cameras stand, by single pictures of an arm whose joints are known.

One picture is enough for a network that knows the arm: its landmarks propose poses, its mask and
outline choose (:mod:`.known`). Several pictures by a camera that stands correct each other:
:func:`~armsight.recognition.own_arm.search_color` begins at what they say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import ColorImage, JointVector, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.recognition.any_arm.edges import at_edges
from armsight.recognition.any_arm.frames import LOOKS, find_lumps
from armsight.recognition.any_arm.known import place_known
from armsight.recognition.any_arm.observing import observe
from armsight.recognition.any_arm.presence import ARM
from armsight.recognition.any_arm.recogniser import FAINT, ArmRecogniser
from armsight.recognition.own_arm.answer import ColorView
from armsight.robots.robot import Robot

SURE_OVERLAP, SURE_LANDMARKS = 0.85, 0.6
"""Overlap and landmarks from which one picture is believed: of 240 tuning pictures of both
renderers 120, of which one put the joints more than 10 cm off, and 12 more than 5 cm."""
DOUBTFUL = 0.6
"""Overlap of the drawn arm with the mask below which a picture says nothing of the camera."""


@dataclass(frozen=True)
class Placed:
    """A camera before an arm.

    Attributes:
        T_base_camera: its pose.
        overlap: of the arm, drawn there, with the network's mask, 0..1.
        landmarks: mean probability of the arm's landmarks.
    """

    T_base_camera: Pose
    overlap: float
    landmarks: float

    @property
    def problem(self) -> str:
        """Why it is not to be believed, empty where it is."""
        if self.overlap < SURE_OVERLAP:
            return f"only {100 * self.overlap:.0f} % of the arm, drawn there, is what is seen"
        if self.landmarks < SURE_LANDMARKS:
            return f"its joints are seen with {100 * self.landmarks:.0f} % only"
        return ""


def place_camera(
    recogniser: ArmRecogniser,
    image: ColorImage,
    lens: PinholeCamera,
    robot: Robot,
    q: JointVector,
    known_as: str = "",
) -> list[Placed]:
    """Where a camera may stand, one pose for each thing in the picture that looks like an arm.

    Args:
        recogniser: whose network is asked.
        image: (h, w, 3) RGB.
        lens: of the picture.
        robot: the arm.
        q: (n,) its joints [rad].
        known_as: the network knows it by this name, its own if left out; there is no answer where
            it knows none of that name.

    Returns:
        The best first, by overlap and landmarks.

    Raises:
        RecognitionError: the network answers with something that is no number.
    """
    name = known_as or robot.name
    marks = recogniser.model.landmarks.get(name)
    if marks is None or len(marks.middle) != robot.n + 1:
        return []
    found: list[Placed] = []
    for longest in LOOKS:
        lumps = find_lumps(recogniser.model, image, longest)[0]
        for lump in lumps:
            if lump.strength < FAINT * lumps[0].strength:
                break
            look, crop = recogniser.looked(image, lens, lump.low, lump.high)
            if not (look.arm > ARM).any():
                continue
            seen = observe(look, crop, name, marks)
            placed = place_known(robot, marks, seen, at_edges(look.arm, crop.image), crop, q)
            if placed is not None:
                fit, overlap = placed
                T = inverse(np.asarray(make_pose(crop.R) @ fit.T_camera_base))
                found.append(Placed(T, overlap, float(look.places[name].mass.mean())))
        if found:
            break
    return sorted(found, key=lambda p: -p.overlap - p.landmarks)


def guess_cameras(
    recogniser: ArmRecogniser,
    lens: PinholeCamera,
    robot: Robot,
    views: Sequence[ColorView],
    known_as: str = "",
) -> list[Pose]:
    """``T_base_camera`` by each of the pictures in which an arm is seen well enough.

    Args:
        recogniser: see :func:`place_camera`.
        lens: of the pictures.
        robot: the arm.
        views: of it.
        known_as: see :func:`place_camera`.
    """
    placed = [
        place_camera(recogniser, view.color, lens, robot, view.joints, known_as) for view in views
    ]
    return [p.T_base_camera for of_view in placed for p in of_view[:1] if p.overlap > DOUBTFUL]
