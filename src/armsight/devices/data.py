"""What devices say, stamped in seconds on the workcell's clock, at exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armsight.arrays import Bytes, ColorImage, DepthImage, Floats, JointVector, Pose
from armsight.devices.depth_model import DepthModel
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.shapes import Solid
from armsight.geometry.stereo import StereoPair


@dataclass(frozen=True)
class JointState:
    """Joints of the arm at one instant, in the URDF's order.

    Attributes:
        stamp: time of measurement [s].
        position: (n,) [rad].
        velocity: (n,) [rad/s].
        effort: (n,) [N m], or None where the arm does not say.
    """

    stamp: float
    position: JointVector
    velocity: JointVector
    effort: JointVector | None = None


ArmMode = Literal["running", "ready", "off", "protective_stop", "emergency_stop", "fault"]
"""``running`` obeys commands; ``ready`` could, once somebody starts it; the others cannot."""


@dataclass(frozen=True)
class ArmStatus:
    """What the arm's own controller says of itself.

    Attributes:
        stamp: time of the reading [s].
        mode: see :data:`ArmMode`.
        speed: share of the commanded speed that the speed slider lets through, 0..1.
        message: the controller's own words, or empty.
    """

    stamp: float
    mode: ArmMode = "running"
    speed: float = 1.0
    message: str = ""

    @property
    def obeys(self) -> bool:
        """Whether commands move the arm now."""
        return self.mode == "running" and self.speed > 0.0

    def __str__(self) -> str:
        words = self.mode.replace("_", " ")
        words += f", speed slider at {100 * self.speed:.0f} %" if self.speed != 1.0 else ""
        return f"{words}: {self.message}" if self.message else words


@dataclass(frozen=True)
class RgbdFrame:
    """One exposure of a depth camera; colour is there only when it was asked for.

    Attributes:
        camera: name of the camera.
        sequence: counts the camera's exposures; a gap is a lost frame.
        stamp: time of exposure [s].
        arrival: when the frame reached the computer [s].
        depth: (h, w) float32 [m] along the optical axis of the depth lens, NaN = no return.
        color: (H, W, 3) uint8 RGB through the colour lens, or None.
        T_base_camera: the depth lens in ``base`` at the exposure, where the device itself knows it
            (a posed recording, a tracked camera). It goes before ``RgbdCameraInfo``'s mounting;
            None means that the mounting says where the camera is.
        infrared: (m h, m w) uint8 the depth lens's own picture, ``infrared_scale`` m times as fine;
            like colour only where it was asked for.
    """

    camera: str
    sequence: int
    stamp: float
    arrival: float
    depth: DepthImage
    color: ColorImage | None = None
    T_base_camera: Pose | None = None
    infrared: Bytes | None = None


@dataclass(frozen=True)
class StereoFrame:
    """One exposure of a stereo pair: (h, w, 3) uint8 RGB each; see :class:`RgbdFrame`."""

    camera: str
    sequence: int
    stamp: float
    arrival: float
    left: ColorImage
    right: ColorImage


@dataclass(frozen=True)
class Wrench:
    """Force [N] and torque [N m] at the flange, in the flange's frame, at ``stamp`` [s]."""

    stamp: float
    force: Floats
    torque: Floats


@dataclass(frozen=True)
class GripperState:
    """Opening of a two-finger gripper.

    Attributes:
        stamp: time of the reading [s].
        width: between the fingertips [m].
        moving: whether the fingers move.
        holding: whether they are held apart by something; None where the gripper does not say.
    """

    stamp: float
    width: float
    moving: bool = False
    holding: bool | None = None


@dataclass(frozen=True)
class SwitchState:
    """Whether a switch is on, at ``stamp`` [s]."""

    stamp: float
    on: bool


@dataclass(frozen=True)
class EmptyCell:
    """Somebody's word, given at ``stamp`` [s], that nobody is in the cell."""

    stamp: float


@dataclass(frozen=True)
class DeclaredSolids:
    """Somebody's word, given at ``stamp`` [s], that solids stand in the cell from now on.

    Attributes:
        stamp: [s]; name: by which they may be withdrawn.
        solids: in ``base``; none: what was declared by this name stands there no more.
    """

    stamp: float
    name: str
    solids: tuple[Solid, ...] = ()


@dataclass(frozen=True)
class DepthNoise:
    """Random depth error that a consumer may assume: sigma(z) = a + b z + c z^2 [m]."""

    a: float
    b: float
    c: float

    def sigma(self, z: Floats) -> Floats:
        """Standard deviation [m] of depth at distance z [m]."""
        return self.a + self.b * z + self.c * z * z

    def fault(self, reach: tuple[float, float]) -> str:
        """Why no camera has this noise over depths from one to another [m]; empty when one may."""
        near, far = reach
        if not 0.0 <= near < far < math.inf:
            return f"a range of {near:g} to {far:g} m; expected two growing distances"
        sigma = self.sigma(np.array([near, 0.5 * (near + far), far]))
        if not ((sigma >= 0.0) & (sigma < math.inf)).all():
            return (
                f"a noise of {sigma[0]:g}, {sigma[1]:g}, {sigma[2]:g} m at {near:g} m, halfway and "
                f"{far:g} m; expected none below 0"
            )
        return ""


@dataclass(frozen=True)
class RgbdCameraInfo:
    """What is known of a depth camera by sheet or calibration, never the simulator's truth.

    Attributes:
        name: unique in the cell.
        model: key of the catalogue, such as ``kinect_v2``.
        depth: depth (infrared) lens.
        color: colour lens, or None.
        T_depth_color: colour lens in the depth lens's frame.
        mounted_on: ``"base"`` for a fixed camera, ``"flange"`` for one the arm carries.
        T_mount_camera: the depth lens in ``base`` or in ``flange``: the calibration.
        rate: frames a second [Hz].
        latency: declared time from exposure to arrival [s].
        range: least and greatest distance [m].
        noise: random depth error.
        guard: whether its pictures are evidence for the map and the guard.
        infrared_scale: pixels of the infrared picture a depth pixel; 0 for a camera without one.
        covariance: (6, 6) of ``T_mount_camera`` (translation [m], rotation [rad], in the camera's
            axes), or None for a camera that stands where somebody has said.
        depth_model: systematic error of its depth that calibration has found, or None.
    """

    name: str
    model: str
    depth: PinholeCamera
    color: PinholeCamera | None
    T_depth_color: Pose
    mounted_on: str
    T_mount_camera: Pose
    rate: float
    latency: float
    range: tuple[float, float]
    noise: DepthNoise
    guard: bool = True
    infrared_scale: int = 0
    covariance: Floats | None = None
    depth_model: DepthModel | None = None

    @property
    def calibrated(self) -> bool:
        """Whether the mounting was measured, not only declared."""
        return self.covariance is not None


@dataclass(frozen=True)
class StereoInfo:
    """What is known of a stereo pair by sheet or calibration, never the simulator's truth.

    Attributes:
        name: unique in the cell.
        model: key of the catalogue, or what the driver calls it.
        left, right: lenses.
        T_left_right: the right lens in the left lens's frame.
        mounted_on: ``"base"`` or ``"flange"``.
        T_mount_camera: the left lens in ``base`` or in ``flange``: the calibration.
        rate: pairs a second [Hz].
        latency: declared time from exposure to arrival [s].
        covariance: (6, 6) of the mounting, in the left lens's axes [m], [rad]; None where it is
            only declared.
    """

    name: str
    model: str
    left: PinholeCamera
    right: PinholeCamera
    T_left_right: Pose
    mounted_on: str
    T_mount_camera: Pose
    rate: float
    latency: float
    covariance: Floats | None = None

    @property
    def lenses(self) -> StereoPair:
        """The two lenses and how they stand to each other."""
        return StereoPair(self.left, self.right, self.T_left_right)
