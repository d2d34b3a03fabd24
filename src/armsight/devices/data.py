"""What devices say, stamped in seconds on the workcell's clock, at exposure."""

from __future__ import annotations

from dataclasses import dataclass

from armsight.arrays import ColorImage, DepthImage, Floats, JointVector, Pose
from armsight.geometry.camera import PinholeCamera


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
    """

    camera: str
    sequence: int
    stamp: float
    arrival: float
    depth: DepthImage
    color: ColorImage | None = None
    T_base_camera: Pose | None = None


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
class DepthNoise:
    """Random depth error that a consumer may assume: sigma(z) = a + b z + c z^2 [m]."""

    a: float
    b: float
    c: float

    def sigma(self, z: Floats) -> Floats:
        """Standard deviation [m] of depth at distance z [m]."""
        return self.a + self.b * z + self.c * z * z


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
