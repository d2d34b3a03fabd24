"""What is said of a picture: the arms in it, each with how sure it is."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.arrays import Floats, Floats32, JointVector, Points, Pose
from armsight.recognition.any_arm.reach import reach_of

Intrinsics = Literal["given", "exif", "assumed"]


@dataclass(frozen=True)
class Arm:
    """An arm in a picture; lengths in [m] in the camera's optical frame.

    Attributes:
        robot: name of its type; ``unknown`` for an arm that is none of the known ones.
        types: probability of each type, ``none`` and ``unknown`` among them.
        mask: (h, w) probability of this arm, at the picture's own size.
        T_camera_base: (4, 4) its pose; None where no pose was found.
        q: (n,) joints [rad]; joints: (n, 3) their origins; covariance: (n, 3, 3) of these [m^2].
        overlap: of the fitted arm's outline with the mask (intersection over union), 0..1.
        trust: probability that the mean joint error is below 100 mm, if the lens is as it was said;
            of k types that it may be as well, at most 1 / k.
        believed: whether ``trust`` is above the one threshold, with what is not known of the lens
            counted in, and the type is no tie; otherwise: "I do not know".
        problem: why it is not believed, else empty.
        alike: robots of extensions that it may as well be: they look like ``robot``, and what was
            known first keeps its answer.
    """

    robot: str
    types: dict[str, float]
    mask: Floats32
    T_camera_base: Pose | None
    q: JointVector
    joints: Points
    covariance: Floats
    overlap: float
    trust: float
    believed: bool
    problem: str
    alike: tuple[str, ...] = ()

    @property
    def base(self) -> Floats:
        """(3,) origin of the base; NaN where no pose was found."""
        if self.T_camera_base is None:
            return np.full(3, np.nan)
        return np.asarray(self.T_camera_base[:3, 3])


@dataclass(frozen=True)
class Sighting:
    """The arms in a picture.

    Attributes:
        name: of the picture.
        arms: believed ones first, then the largest.
        K: (3, 3) camera of the picture [px]; distortion: (5,) of its lens.
        intrinsics: given, from the picture's own file, or assumed, and with it every metre.
        notes: what makes the answers less sure, in words.
    """

    name: str
    arms: tuple[Arm, ...]
    K: Floats
    distortion: Floats
    intrinsics: Intrinsics
    notes: tuple[str, ...]

    def pixels(self, arm: Arm) -> Floats:
        """(1 + n, 2) base, then joints of one of the arms, in the picture [px]."""
        from armsight.recognition.inference.intrinsics import project

        return project(np.vstack([arm.base[None], arm.joints]), self.K, self.distortion)

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "picture": self.name,
            "arms": [self._arm(arm) for arm in self.arms],
            "intrinsics": self.intrinsics,
            "K": np.round(self.K, 3).tolist(),
            "notes": list(self.notes),
        }

    def _arm(self, arm: Arm) -> dict[str, Any]:
        placed = arm.T_camera_base is not None
        pixels = self.pixels(arm) if placed else np.empty((0, 2))
        return {
            "robot": arm.robot,
            "probabilities": {k: round(v, 4) for k, v in arm.types.items()},
            "mask_share": round(float((arm.mask >= 0.5).mean()), 5),
            "believed": arm.believed,
            "trust": round(arm.trust, 3),
            "problem": arm.problem or None,
            "may_as_well_be": list(arm.alike),
            "T_camera_base": np.round(arm.T_camera_base, 5).tolist() if placed else None,  # type: ignore[arg-type]
            "joints_rad": [round(float(v), 4) for v in arm.q] if placed else None,
            "joints_camera_m": [[round(float(v), 4) for v in p] for p in arm.joints] or None,
            "joint_sigma_m": [round(_sigma(C), 4) for C in arm.covariance] or None,
            "reach": reach_of(arm).to_json(),
            "outline_overlap": round(arm.overlap, 3) if placed else None,
            "base_px": _row(pixels[0]) if placed else None,
            "joints_px": [_row(p) for p in pixels[1:]] if placed else None,
        }

    def as_line(self) -> str:
        """The JSON in one line."""
        # ASCII: a file's name may hold bytes that no terminal and no UTF-8 file takes.
        return json.dumps(self.to_json(), allow_nan=False)


def _sigma(C: Floats) -> float:
    """Standard deviation of a place, all directions together [m]."""
    return float(np.sqrt(max(np.trace(C), 0.0)))


def _row(p: Floats) -> list[float | None]:
    return [round(float(v), 1) if math.isfinite(v) else None for v in p]
