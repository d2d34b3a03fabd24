"""The driver port: what somebody writes to bring a device of their own.

A driver is a class that is called with its settings, opens the device, and is then read. It may
block: armsight runs every driver in a thread of its own and counts it lost when a call has not
returned in time. Nothing here needs a base class; a class with these methods is a driver. It is
found by an entry point of :data:`GROUPS` or named in the cell file as ``module:Class``.

Times of a driver are seconds on the device's own clock, wherever that starts: armsight maps them to
the workcell's (:mod:`armsight.devices.clock_map`). A driver whose device tells no time says None.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

from armsight.arrays import Bytes, ColorImage, DepthImage, Floats, JointVector, Pose
from armsight.devices.data import ArmMode, DepthNoise
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera

Kind = Literal["arm", "camera", "stereo", "wrench", "gripper", "switch"]
GROUPS: dict[Kind, str] = {
    "arm": "armsight.arms",
    "camera": "armsight.cameras",
    "stereo": "armsight.stereo_cameras",
    "wrench": "armsight.wrench_sensors",
    "gripper": "armsight.grippers",
    "switch": "armsight.switches",
}
"""Entry-point group of each kind of driver."""

Connection: TypeAlias = Mapping[str, str | int | float | bool]
"""The ``connection`` table of the cell file: whatever the driver's page asks for."""


def sdk(module: str, install: str) -> Any:
    """Import a maker's package when a driver needs it, not when it is listed.

    Args:
        module: to import, such as ``pyrealsense2``.
        install: what to give to pip, such as ``armsight-realsense[sdk]``.

    Raises:
        DeviceError: it is not installed; says how to.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DeviceError(
            f"the maker's package {module} cannot be imported ({error}); "
            f"install it: pip install '{install}'"
        ) from error


# --- arm -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ArmSettings:
    """What an arm's driver is told.

    Attributes:
        name: of the robot, for messages.
        connection: the cell file's ``[robot.connection]``.
        joint_names: (n) in the URDF's order, that of every joint vector.
        velocity: (n,) greatest speeds that this cell allows [rad/s].
        acceleration: (n,) likewise [rad/s^2].
        rate: readings a second that are wanted [Hz].
        watchdog: the arm has to stop when no command came for this long [s].
    """

    name: str
    connection: Connection
    joint_names: tuple[str, ...]
    velocity: JointVector
    acceleration: JointVector
    rate: float
    watchdog: float


@dataclass(frozen=True)
class ArmReading:
    """Joints of the arm at one instant.

    Attributes:
        stamp: of the measurement on the device's clock [s], or None.
        position: (n,) [rad].
        velocity: (n,) [rad/s].
        effort: (n,) [N m], or None.
        mode, speed, message: see :class:`~armsight.devices.data.ArmStatus`.
    """

    stamp: float | None
    position: JointVector
    velocity: JointVector
    effort: JointVector | None = None
    mode: ArmMode = "running"
    speed: float = 1.0
    message: str = ""


class ArmDriver(Protocol):
    """Called with :class:`ArmSettings`. One thread reads and commands; see :meth:`stop`."""

    def read(self) -> ArmReading | None:
        """The newest reading; may wait for the next one, but not longer than a few periods.

        Raises:
            DeviceError: the arm is lost.
        """
        ...

    def command_velocity(self, velocity: JointVector) -> JointVector | None:
        """Send (n,) joint velocities [rad/s], within the settings' limits already.

        Returns what was sent where that differs, else None.

        Raises:
            DeviceError: the arm is lost, or refuses (it may be asked again).
        """
        ...

    def stop(self) -> None:
        """Brake and hold. Comes from any thread, at any time, also while another call hangs."""
        ...

    def close(self) -> None:
        """Let go of the arm; it has been stopped. Comes last, perhaps from another thread."""
        ...


# --- cameras ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class CameraSettings:
    """What a camera's driver is told; a stereo pair's as well.

    Attributes:
        name: of the camera in the cell, for messages.
        connection: the cell file's ``[camera.connection]``.
        rate: exposures a second that are wanted [Hz]; None for the driver's choice.
    """

    name: str
    connection: Connection = field(default_factory=dict)
    rate: float | None = None


@dataclass(frozen=True)
class CameraReport:
    """What a depth camera says it is, once it is open.

    Attributes:
        model: for people, such as the maker's name with the serial number.
        depth: intrinsics of the depth lens; color: of the colour lens, or None.
        rate: exposures a second [Hz].
        range: least and greatest depth that can be trusted [m].
        noise: random error of depth.
        latency: exposure to arrival in the computer [s].
        T_depth_color: colour lens in the depth lens's frame.
        infrared_scale: pixels of the depth lens's own (infrared) picture a depth pixel; 0 for a
            camera that does not deliver it.
    """

    model: str
    depth: PinholeCamera
    rate: float
    range: tuple[float, float]
    noise: DepthNoise
    latency: float = 0.03
    color: PinholeCamera | None = None
    T_depth_color: Pose = field(default_factory=lambda: np.eye(4))
    infrared_scale: int = 0


@dataclass(frozen=True)
class DepthReading:
    """One exposure.

    Attributes:
        stamp: of the exposure (its middle) on the device's clock [s], or None.
        depth: (h, w) float32 [m] along the optical axis; NaN (or 0) where there is no return.
        color: (H, W, 3) uint8 RGB, or None.
        sequence: the device's own count of exposures, or None.
        infrared: (m h, m w) uint8 the depth lens's own picture, m the report's scale, or None.
            16 bits are to be scaled down so that a white sheet is bright, not saturated.
    """

    stamp: float | None
    depth: DepthImage
    color: ColorImage | None = None
    sequence: int | None = None
    infrared: Bytes | None = None


class CameraDriver(Protocol):
    """Called with :class:`CameraSettings`. Everything but :meth:`close` comes from one thread.

    One that delivers infrared may also have ``want_infrared(wanted: bool)``, like
    :meth:`want_color`.
    """

    @property
    def report(self) -> CameraReport:
        """What it is; must be the same every time that this device is opened."""
        ...

    def read(self) -> DepthReading | None:
        """The newest exposure that was not read yet; may wait for the next one.

        Raises:
            DeviceError: the camera is lost; it is closed and opened again.
        """
        ...

    def want_color(self, wanted: bool) -> None:
        """Deliver colour beside depth from now on, or spare it. May be ignored."""
        ...

    def close(self) -> None:
        """Let go of the camera. May come from another thread while a read hangs."""
        ...


@dataclass(frozen=True)
class StereoReport:
    """What a stereo pair says it is; see :class:`CameraReport`.

    Attributes:
        left, right: intrinsics of the lenses, with the distortion that their pictures have.
        T_left_right: the right lens in the left one's frame: about ``(baseline, 0, 0)`` [m].
    """

    model: str
    left: PinholeCamera
    right: PinholeCamera
    T_left_right: Pose
    rate: float
    latency: float = 0.03


@dataclass(frozen=True)
class StereoReading:
    """One exposure of both lenses at once: (h, w, 3) uint8 RGB each; see :class:`DepthReading`."""

    stamp: float | None
    left: ColorImage
    right: ColorImage
    sequence: int | None = None


class StereoDriver(Protocol):
    """Called with :class:`CameraSettings`; like :class:`CameraDriver`."""

    @property
    def report(self) -> StereoReport:
        """What it is."""
        ...

    def read(self) -> StereoReading | None:
        """The newest pair that was not read yet; may wait for the next one."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


# --- hand ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WrenchSettings:
    """What a force sensor's driver is told: connection, and readings a second [Hz]."""

    connection: Connection
    rate: float


@dataclass(frozen=True)
class WrenchReading:
    """What the flange feels: force [N] and torque [N m], (3,) each, in the flange's frame.

    The tool's weight is in it, as the sensor feels it.
    """

    stamp: float | None
    force: Floats
    torque: Floats


class WrenchDriver(Protocol):
    """Called with :class:`WrenchSettings`."""

    def read(self) -> WrenchReading | None:
        """The newest reading; may wait for the next one."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


@dataclass(frozen=True)
class GripperSettings:
    """What a gripper's driver is told.

    Attributes:
        connection: the cell file's ``[gripper.connection]``.
        opening: greatest width [m].
        speed: of the fingers against each other [m/s].
        force: with which they close [N].
    """

    connection: Connection
    opening: float
    speed: float
    force: float


@dataclass(frozen=True)
class GripperReading:
    """State of the fingers; see :class:`~armsight.devices.data.GripperState`."""

    stamp: float | None
    width: float
    moving: bool = False
    holding: bool | None = None


class GripperDriver(Protocol):
    """Called with :class:`GripperSettings`. One thread reads and commands."""

    def read(self) -> GripperReading | None:
        """The newest reading."""
        ...

    def move(self, width: float) -> None:
        """Begin to open or close to a width [m]; does not wait for the fingers.

        Raises:
            DeviceError: it refuses; it is asked again.
        """
        ...

    def close(self) -> None:
        """Let go of it; the fingers stay."""
        ...


# --- switch ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class SwitchSettings:
    """What a switch's driver is told: connection, and readings a second [Hz]."""

    connection: Connection
    rate: float


@dataclass(frozen=True)
class SwitchReading:
    """Whether it is on."""

    stamp: float | None
    on: bool


class SwitchDriver(Protocol):
    """Called with :class:`SwitchSettings`."""

    def read(self) -> SwitchReading | None:
        """The state now; may wait for as long as a reading of this rate takes."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...
