"""From a picture to the robot in it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from armsight.arrays import Floats, Floats32, Points, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.inference.intrinsics import View, check_size, project, view_through
from armsight.recognition.inference.model import Model, validation_figure
from armsight.recognition.inference.no_robot import robot_share
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.networks.architecture import JOINTS

_CUT_SHARE = 0.04
_UNSURE = 0.7
_BAD_MM = 100.0

Intrinsics = Literal["given", "exif", "assumed"]


@dataclass(frozen=True)
class Recognition:
    """What a network sees in a picture.

    Attributes:
        name: of the picture.
        robot: name of the type, None where no robot is found.
        reason: why there is none, else empty.
        probabilities: of each type that the network knows.
        mask: (h, w) probability of robot, at the picture's own size.
        base: (3,) origin of the robot's base in the camera's frame [m].
        joints: (j, 3) joint origins in the camera's frame [m].
        K: (3, 3) camera of the picture [px].
        distortion: (5,) of its lens.
        intrinsics: given, from the picture's own file (exif), or assumed, and with it every metre.
        expected_mm: mean joint error on validation frames by the network's card; NaN if unknown.
        notes: what makes the answer less sure, in words.
    """

    name: str
    robot: str | None
    reason: str
    probabilities: dict[str, float]
    mask: Floats32
    base: Vector3
    joints: Points
    K: Floats
    distortion: Floats
    intrinsics: Intrinsics
    expected_mm: float
    notes: tuple[str, ...]

    def pixels(self) -> Floats:
        """(1 + j, 2) base, then joints, in the picture [px]; NaN behind the camera."""
        points = np.vstack([self.base[None], self.joints])
        return project(points, self.K, self.distortion)

    def to_json(self) -> dict[str, Any]:
        """As JSON values; lengths in [m] in the camera's optical frame."""
        found = self.robot is not None
        pixels = [[_number(v) for v in row] for row in self.pixels()] if found else []
        return {
            "picture": self.name,
            "robot": self.robot,
            "reason": self.reason or None,
            "probabilities": {k: round(v, 4) for k, v in self.probabilities.items()},
            "mask_share": round(float((self.mask >= 0.5).mean()), 5),
            "base_camera_m": [round(float(v), 4) for v in self.base] if found else None,
            "joints_camera_m": (
                [[round(float(v), 4) for v in p] for p in self.joints] if found else None
            ),
            "base_px": pixels[0] if found else None,
            "joints_px": pixels[1:] if found else None,
            "intrinsics": self.intrinsics,
            "K": np.round(self.K, 3).tolist(),
            "expected_joint_error_mm": _number(self.expected_mm),
            "notes": list(self.notes),
        }


class Recogniser:
    """Asks one network about pictures.

    Args:
        model: the network.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    def recognise(self, picture: Picture, camera: PinholeCamera | None = None) -> Recognition:
        """The robot in a picture.

        Args:
            picture: of any size.
            camera: of that picture; None to assume the network's own.

        Raises:
            RecognitionError: the network answers with something that is no number, or the camera is
                of pictures of another size.
        """
        a = self.model.architecture
        if camera is not None:
            check_size(camera, picture.image.shape[1], picture.image.shape[0])
        view = view_through(picture.image, camera, self.model.K, a.width, a.height)
        answer = self.model.run(view.image)
        best = int(np.argmax(answer.type))
        robot = a.robots[best]
        share, least = robot_share(answer.mask), self.model.no_robot_share
        reason = ""
        if share < least:
            reason = (
                f"no robot found: {100 * share:.1f} % of the picture look like one, less than "
                f"{100 * least:.1f}"
            )
        expected = validation_figure(self.model.card, robot, "joint_mean_mm")
        exif = camera is not None and camera is picture.camera
        notes = [*picture.notes, *self._notes(view, answer.mask, float(answer.type[best]), exif)]
        if not expected < _BAD_MM:
            notes.append(self._warning(expected, robot))
        return Recognition(
            picture.name,
            None if reason else robot,
            reason,
            {name: float(p) for name, p in zip(a.robots, answer.type, strict=True)},
            self._mask(answer.mask, view, picture.image.shape[:2]),
            answer.base.astype(float),
            answer.joints[: JOINTS[robot]].astype(float),
            view.K,
            view.distortion,
            self._source(view, picture, camera),
            expected,
            tuple(notes),
        )

    def _source(self, view: View, picture: Picture, camera: PinholeCamera | None) -> Intrinsics:
        if not view.given:
            return "assumed"
        return "exif" if camera is picture.camera else "given"

    def _notes(self, view: View, mask: Floats32, probability: float, exif: bool) -> list[str]:
        notes = []
        if exif:
            notes.append(
                "focal length from the picture's own file, which is rounded: distances may be off "
                "by as many percent, some 5"
            )
        if not view.given:
            fov = 2 * math.degrees(math.atan(0.5 * mask.shape[1] / self.model.K[0, 0]))
            notes.append(
                f"intrinsics not given: metres hold for a lens of {fov:.0f} deg across the picture"
            )
        if view.covered < 0.8:
            notes.append(f"the picture fills {100 * view.covered:.0f} % of what the network sees")
        seen = mask >= 0.5
        edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        if edge.mean() > _CUT_SHARE:
            notes.append("the robot is cut by the frame: joints outside it are guesses")
        if probability < _UNSURE:
            notes.append(f"the type is unsure ({100 * probability:.0f} %)")
        return notes

    def _warning(self, expected: float, robot: str) -> str:
        name = self.model.name
        if math.isnan(expected):
            return f"network {name} does not say how good it is on this type"
        right = validation_figure(self.model.card, robot, "type_accuracy")
        types = "" if math.isnan(right) else f", and {100 * right:.0f} % of its types were right"
        return (
            f"network {name} is weak, do not rely on it: in its own test joints were off by "
            f"{expected:.0f} mm on average{types}"
        )

    def _mask(self, mask: Floats32, view: View, shape: tuple[int, ...]) -> Floats32:
        """The mask at the picture's own size."""
        rows, columns = shape[:2]
        v, u = np.mgrid[0:rows, 0:columns].astype(np.float32)
        pixels = np.stack([u.ravel(), v.ravel()], -1)
        if view.distortion.any():
            rays = cv2.undistortPoints(
                pixels.astype(np.float64).reshape(-1, 1, 2), view.K, view.distortion
            ).reshape(-1, 2)
        else:
            centre, focal = view.K[:2, 2], np.diag(view.K)[:2]
            rays = (pixels - centre) / focal
        K = self.model.K
        where = (rays * np.diag(K)[:2] + K[:2, 2]).astype(np.float32).reshape(rows, columns, 2)
        found = cv2.remap(
            mask, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return np.asarray(found, np.float32)


def _number(value: float) -> float | None:
    return round(float(value), 2) if math.isfinite(value) else None


def as_line(recognition: Recognition) -> str:
    """The JSON of a recognition in one line."""
    # ASCII: a file's name may hold bytes that no terminal and no UTF-8 file takes.
    return json.dumps(recognition.to_json(), allow_nan=False)
