"""Answers of the arm recogniser on labelled frames, one record a frame."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.edges import at_edges
from armsight.recognition.any_arm.known import place_known
from armsight.recognition.any_arm.observing import observe
from armsight.recognition.any_arm.reach import UNKNOWN, reach_of
from armsight.recognition.any_arm.recogniser import MARGIN, ArmRecogniser
from armsight.recognition.any_arm.sighting import Sighting
from armsight.recognition.any_arm.views import SIDE, take_crop
from armsight.recognition.data.sample import KNOWN_ROBOTS, Sample
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.inference.recogniser import Recogniser
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses

INSIDE_90 = 6.251
"""Of chi squared with three degrees of freedom, 90 %."""
CROP = 160.0
"""Side of the crop that errors of landmarks are given for [px]."""
NAN = float("nan")
NOTHING = 1e4
"""Joint error of a frame without an answer [mm]."""


@dataclass(frozen=True)
class Frame:
    """What was said of a frame, and how right it was.

    Attributes:
        robot: in it.
        said: type of the surest arm, ``none`` where no arm is found.
        iou: of all masks together.
        error: mean joint error [mm]; known: the same with the joint angles given.
        believed: the answer passes its own check.
        inside: share of the joints 2 to 5 in their 90 % ellipsoids; NaN without an answer.
        landmarks: (k,) errors of the visible landmarks in a crop with the box given [px].
        cpu: processor time of the answer [s].
        distance: of the base [m].
        reach: of the camera from the arm's reach [m], true, said, and said at least; NaN where
            there is no arm of the five, and where nothing is said.
    """

    robot: str
    said: str
    iou: float
    error: float
    known: float
    believed: bool
    inside: float
    landmarks: Floats
    cpu: float
    distance: float
    reach: tuple[float, float, float] = (NAN, NAN, NAN)


def try_frame(recogniser: ArmRecogniser, sample: Sample) -> Frame:
    """One frame, its box not given and its intrinsics known."""
    lens = sample.camera
    begun = time.process_time()
    found = recogniser.recognise(Picture("frame", sample.image), lens)
    cpu = time.process_time() - begun
    error, inside = joint_error(found, sample)
    landmarks, known = np.empty(0), NOTHING
    if sample.robot in KNOWN_ROBOTS:
        given = given_box(recogniser, sample, lens)
        landmarks, known = given.landmarks, given.error(sample)
    return Frame(
        sample.robot,
        found.arms[0].robot if found.arms else "none",
        _iou(found, sample),
        error,
        known,
        bool(found.arms) and found.arms[0].believed,
        inside,
        landmarks,
        cpu,
        float(np.linalg.norm(sample.base_camera)),
        reaches(found, sample),
    )


def reaches(found: Sighting, sample: Sample) -> tuple[float, float, float]:
    """See ``Frame.reach``."""
    if sample.robot not in KNOWN_ROBOTS:
        return NAN, NAN, NAN
    shoulder = float(np.linalg.norm(sample.joints_camera[1]))
    said = reach_of(found.arms[0]) if found.arms else UNKNOWN
    return shoulder - load_robot(sample.robot).stretched, said.distance, said.least


def baseline_frame(recogniser: Recogniser, sample: Sample) -> Frame:
    """One of the papers' networks on the same frame."""
    begun = time.process_time()
    found = recogniser.recognise(Picture("frame", sample.image), sample.camera)
    cpu = time.process_time() - begun
    n = len(sample.joints_camera)
    error = NOTHING
    if found.robot is not None and len(found.joints) == n > 0:
        error = 1e3 * float(np.linalg.norm(found.joints - sample.joints_camera, axis=1).mean())
    seen = (found.mask >= 0.5) & (found.robot is not None)
    either = float((seen | sample.mask).sum())
    iou = float((seen & sample.mask).sum()) / max(either, 1.0)
    return Frame(
        sample.robot, found.robot or "none", iou, error, NOTHING, found.robot is not None,
        float("nan"), np.empty(0), cpu, float(np.linalg.norm(sample.base_camera)),
    )  # fmt: skip


def joint_error(found: Sighting, sample: Sample) -> tuple[float, float]:
    """Mean joint error of the surest arm [mm], and the share of joints in their ellipsoids."""
    arm = found.arms[0] if found.arms else None
    true = sample.joints_camera
    if arm is None or len(arm.joints) != len(true) or not len(true):
        return NOTHING, float("nan")
    away = arm.joints - true
    C = arm.covariance[1:5] + 1e-9 * np.eye(3)
    squares = np.einsum("ni,nij,nj->n", away[1:5], np.linalg.inv(C), away[1:5])
    return 1e3 * float(np.linalg.norm(away, axis=1).mean()), float((squares < INSIDE_90).mean())


def _iou(found: Sighting, sample: Sample) -> float:
    seen = np.zeros_like(sample.mask)
    for arm in found.arms:
        seen |= arm.mask >= 0.5
    return float((seen & sample.mask).sum() / max((seen | sample.mask).sum(), 1))


@dataclass(frozen=True)
class Given:
    """What is found where box and joint angles are given.

    Attributes:
        landmarks: (k,) errors of the visible landmarks [px of a crop of 160 px].
        places: (1 + n, 3) base and joints in the camera's frame [m], None without an answer.
    """

    landmarks: Floats
    places: Floats | None

    def error(self, sample: Sample) -> float:
        """Mean joint error [mm]."""
        if self.places is None:
            return NOTHING
        return 1e3 * float(np.linalg.norm(self.places[1:] - sample.joints_camera, axis=1).mean())


def given_box(recogniser: ArmRecogniser, sample: Sample, lens: PinholeCamera) -> Given:
    """Landmarks and the arm's place, its box and angles given."""
    row, column = np.nonzero(sample.mask)
    low = np.array([column.min(), row.min()], float)
    high = np.array([column.max() + 1, row.max() + 1], float)
    given = take_crop(sample.image, lens, low, high, MARGIN)
    look, crop = recogniser.looked(sample.image, lens, low, high)
    robot, marks = load_robot(sample.robot), recogniser.model.landmarks[sample.robot]
    T_link = sample.T_camera_base @ link_poses(robot, sample.q)
    true = marks.placed(T_link)
    ids = sample.link_ids
    errors = []
    places = look.places[sample.robot]
    for k, (u, v) in enumerate(np.round(lens.project(true))):
        if not (np.isfinite(u) and 1 <= u < lens.width - 1 and 1 <= v < lens.height - 1):
            continue
        window = ids[int(v) - 1 : int(v) + 2, int(u) - 1 : int(u) + 2].astype(int)
        # A joint's origin lies within the links that it joins.
        if (np.abs(window - (marks.link[k] + 1)) <= 1)[window > 0].any():
            at = places.mean[k] * 4 + 1.5
            pixels = float(np.linalg.norm(at - crop.pixels(true[k : k + 1])[0]))
            errors.append(pixels * given.f / crop.f * CROP / SIDE)
    seen = observe(look, crop, sample.robot, marks)
    arm = at_edges(look.arm, crop.image)
    found = place_known(robot, marks, seen, arm, crop, sample.q)
    if found is None:
        return Given(np.array(errors), None)
    fit = found[0]
    return Given(
        np.array(errors),
        np.asarray(np.vstack([fit.T_camera_base[None, :3, 3], fit.joints()]) @ crop.R.T),
    )


def set_of(name: str) -> Path:
    """Where the frames of another renderer than the training set's lie."""
    from armsight.experiments.recognition_scores import folder

    return folder() / "sets" / name
