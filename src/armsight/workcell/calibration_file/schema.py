"""What stands in a calibration file: measured poses, lenses, depth errors, and how sure they are.

All lengths are metres and all angles radians, but for keys that end in ``_deg``; poses are in
``base`` (fixed cameras) or in ``flange``, so that a cell that is moved as a whole stays calibrated.
"""

from __future__ import annotations

import datetime
import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from armsight.arrays import Floats, Pose
from armsight.devices.depth_model import DepthModel
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_quaternion, inverse, log
from armsight.workcell.fields import (
    Name,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    Section,
    Text,
    Triple,
    key,
)

Size = Annotated[int, Field(strict=True, ge=2, le=20_000)]
Five = tuple[Number, Number, Number, Number, Number]
Numbers = Annotated[tuple[Number, ...], Field(max_length=64)]
Row = tuple[Number, Number, Number, Number, Number, Number]
Matrix = tuple[Row, Row, Row, Row, Row, Row]
Moment = datetime.datetime
FARTHEST = 10.0
"""Nothing in a cell is farther from its mount [m]."""


class PlacedSection(Section):
    """Something with a pose: a rotation and a translation, nothing else."""

    position: Triple = key(..., "Origin of the lens in its mount.", "m")
    quaternion_xyzw: Quaternion = key(..., "Rotation of the optical frame, w last.")

    @model_validator(mode="after")
    def _rigid(self) -> PlacedSection:
        check_rigid("", self.position, self.quaternion_xyzw)
        return self

    @property
    def pose(self) -> Pose:
        """As a transform."""
        return from_quaternion(self.quaternion_xyzw, self.position)


class LensSection(Section):
    """A lens: OpenCV's pinhole with k1, k2, p1, p2, k3; pixel centres are whole numbers."""

    width: Size = key(..., "Of the picture.", "px")
    height: Size = key(..., "Of the picture.", "px")
    fx: Positive = key(..., "Focal length along u.", "px")
    fy: Positive = key(..., "Focal length along v.", "px")
    cx: Number = key(..., "Principal point.", "px")
    cy: Number = key(..., "Principal point.", "px")
    distortion: Five = key((0.0, 0.0, 0.0, 0.0, 0.0), "k1, k2, p1, p2, k3.")

    @model_validator(mode="after")
    def _sane(self) -> LensSection:
        for name, f, size in (("fx", self.fx, self.width), ("fy", self.fy, self.height)):
            if not 0.1 * size < f < 20.0 * size:
                raise ValueError(
                    f"{name} is {f:g} px for a picture of {size} px, expected 0.1 to 20 times as "
                    "many: is the lens of another resolution?"
                )
        for name, c, size in (("cx", self.cx, self.width), ("cy", self.cy, self.height)):
            if not 0.0 < c < size:
                raise ValueError(f"{name} is {c:g} px, outside a picture of {size} px")
        return self

    @property
    def lens(self) -> PinholeCamera:
        """As the library has it."""
        return PinholeCamera(
            self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.distortion
        )


class ColorLensSection(LensSection, PlacedSection):
    """The colour lens, in the depth lens's frame."""


class DepthModelSection(Section):
    """Systematic error of the depth: measured = true + error; see ``devices/depth_model.py``."""

    offset: Number = key(..., "At the middle of the range.", "m")
    scale: Number = key(0.0, "Growth of the error with depth.")
    middle: Positive = key(..., "Depth about which the scale turns.", "m")
    knots: Numbers = key((), "Depths of the curve's knots.", "m")
    values: Numbers = key((), "Of the curve at the knots.", "m")
    surface: Triple = key((0.0, 0.0, 0.0), "Of u, v and r squared over half the image.", "m")
    range: tuple[Positive, Positive] = key(..., "Depths that were looked at.", "m")
    rms: NotNegative = key(0.0, "What is left from board to board.", "m")

    @model_validator(mode="after")
    def _sane(self) -> DepthModelSection:
        if len(self.knots) != len(self.values):
            raise ValueError(
                f"found {len(self.knots)} knots and {len(self.values)} values, expected as many"
            )
        if any(b <= a for a, b in zip(self.knots, self.knots[1:])):
            raise ValueError("the knots do not rise, expected depths from near to far")
        if self.range[0] >= self.range[1]:
            raise ValueError(f"range is {list(self.range)}, expected from near to far")
        if abs(self.offset) > 0.3 or abs(self.scale) > 0.3:
            raise ValueError(
                f"offset is {self.offset:g} m and scale {self.scale:g}, expected within 0.3: no "
                "depth camera is that wrong"
            )
        return self

    @property
    def model(self) -> DepthModel:
        """As the library has it."""
        return DepthModel(
            self.offset,
            self.scale,
            np.array(self.knots, float),
            np.array(self.values, float),
            np.array(self.surface, float),
            self.middle,
            self.range,
            self.rms,
            self.scale != 0.0,
        )


class DeclaredSection(PlacedSection):
    """Where the workcell file put the camera when it was calibrated, in the same mount."""


class MeasuredSection(PlacedSection):
    """A pose that was found, how sure it is, and where it was declared to be."""

    covariance: Matrix = key(..., "Of the pose: translation, then rotation, in its own axes.")
    declared: DeclaredSection = key(..., "Where the workcell file put it then.")

    @model_validator(mode="after")
    def _covariance_possible(self) -> MeasuredSection:
        C = np.array(self.covariance)
        if not np.allclose(C, C.T, rtol=1e-6, atol=1e-15):
            raise ValueError("covariance is not symmetric")
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(C), 1e-30))
        if np.diagonal(C).min() <= 0.0 or np.linalg.eigvalsh(C * scale[:, None] * scale)[0] < -1e-6:
            raise ValueError("covariance is not positive definite: no errors spread like that")
        return self

    @property
    def C(self) -> Floats:
        """(6, 6) covariance of the pose."""
        return np.array(self.covariance)

    def moved(self, T_mount_declared: Pose) -> bool:
        """Whether it is declared elsewhere than when it was calibrated."""
        step = log(inverse(self.declared.pose) @ T_mount_declared)
        return bool(np.linalg.norm(step[:3]) > 1e-4 or np.linalg.norm(step[3:]) > 1e-4)


class CalibratedCamera(MeasuredSection):
    """One camera: its depth lens's pose in base or flange, its lenses, its depth errors."""

    name: Name = key(..., "As in the workcell file.")
    model: Text = key(..., "As in the workcell file.")
    mount: Literal["base", "flange"] = key(..., "What the pose is in.")
    calibrated: Moment = key(..., "When.")
    source: Text = key("", "From what.")
    target_error: Positive | None = key(
        None, "Expected error of a point 1.0 to 1.5 m away, by the calibration itself.", "m"
    )
    depth_lens: LensSection = key(..., "The depth (infrared) lens, at the depth image's size.")
    color_lens: ColorLensSection | None = key(None, "The colour lens.")
    depth_model: DepthModelSection | None = key(None, "Systematic error of its depth.")


class CalibratedArm(Section):
    """Errors of the arm that were found, against its data sheet."""

    calibrated: Moment = key(..., "When.")
    source: Text = key("", "From what.")
    joint_offset_deg: Annotated[tuple[Number, ...], Field(min_length=1, max_length=16)] = key(
        ..., "Added to what each joint reports.", "deg"
    )
    origin_shift: Annotated[tuple[Triple, ...], Field(min_length=1, max_length=16)] = key(
        ..., "Added to each joint's origin, in its parent's frame.", "m"
    )

    @model_validator(mode="after")
    def _small(self) -> CalibratedArm:
        if len(self.joint_offset_deg) != len(self.origin_shift):
            raise ValueError(
                f"found {len(self.joint_offset_deg)} joint offsets and {len(self.origin_shift)} "
                "origin shifts, expected one of each a joint"
            )
        if max(map(abs, self.joint_offset_deg)) > 5.0:
            raise ValueError("a joint offset is above 5 deg: home the arm instead")
        if max(abs(v) for row in self.origin_shift for v in row) > 0.02:
            raise ValueError("an origin shift is above 0.02 m: is it another arm?")
        return self


class CalibratedBoard(PlacedSection):
    """Where the board truly hangs: the middle of its corners, as in the workcell file."""

    mounted_on: Literal["flange", "world"] = key(..., "As in the workcell file.")
    calibrated: Moment = key(..., "When.")
    source: Text = key("", "From what.")
    declared: DeclaredSection = key(..., "Where the workcell file put it then.")


class CalibratedStereo(MeasuredSection):
    """One stereo pair: its left lens's pose in base. Its lenses stay as they are declared."""

    name: Name = key(..., "As in the workcell file.")
    model: Text = key(..., "As in the workcell file.")
    mount: Literal["base", "flange"] = key(..., "What the pose is in.")
    calibrated: Moment = key(..., "When.")
    source: Text = key("", "From what.")


class CalibratedPlug(MeasuredSection):
    """Where its mount holds the charging plug: the tip on the flange, nothing hanging on it."""

    kind: Name = key(..., "As in the workcell file.")
    calibrated: Moment = key(..., "When.")
    source: Text = key("", "From what.")
    tip_error: Positive | None = key(
        None, "Expected error of the tip against what the pair sees, where it looks.", "m"
    )


class CalibratedCell(Section):
    """Whose calibration it is."""

    name: Name = key(..., "Name of the cell.")
    robot: Text = key(..., "Model of its robot.")


class CellCalibration(Section):
    """A whole calibration file."""

    cell: CalibratedCell = key(..., "Whose it is.")
    arm: CalibratedArm | None = key(None, "Errors of the arm.")
    board: CalibratedBoard | None = key(None, "Where the board hangs.")
    camera: tuple[CalibratedCamera, ...] = key((), "The cameras that were calibrated.")
    stereo: tuple[CalibratedStereo, ...] = key((), "The stereo pairs that were calibrated.")
    plug: CalibratedPlug | None = key(None, "Where the charging plug sits.")

    def of(self, name: str) -> CalibratedCamera | None:
        """The entry of a camera, or None."""
        return next((c for c in self.camera if c.name == name), None)

    def of_pair(self, name: str) -> CalibratedStereo | None:
        """The entry of a stereo pair, or None."""
        return next((c for c in self.stereo if c.name == name), None)


def check_rigid(where: str, position: tuple[float, ...], quaternion: tuple[float, ...]) -> None:
    """Refuse what is no rotation and translation.

    Raises:
        ValueError: says what it is instead.
    """
    length = math.hypot(*quaternion)
    if abs(length - 1.0) > 1e-3:
        raise ValueError(
            f"{where}quaternion_xyzw has length {length:.4g}, expected 1: it is no rotation"
        )
    if max(map(abs, position)) > FARTHEST:
        raise ValueError(
            f"{where}position {list(position)} is farther than {FARTHEST:g} m, expected metres"
        )
