"""What the rest of armsight may ask of a device, whichever driver stands behind it.

A driver is simulated, recorded or real; nothing outside ``devices`` and ``simulation`` can tell.
"""

from __future__ import annotations

from typing import Protocol

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame, StereoFrame, Wrench


class Clock(Protocol):
    """The workcell's time."""

    def now(self) -> float:
        """Seconds since the clock's start; never runs backwards."""
        ...


class Arm(Protocol):
    """A robot arm under joint velocity control. Only the guard commands it."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        ...

    def read(self) -> JointState | None:
        """The newest reading that has arrived, or None before the first.

        Raises:
            DeviceError: the arm is lost.
        """
        ...

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Ask for (n,) joint velocities [rad/s]; returns what was really sent after limits.

        The arm stops by itself when no command came for its watchdog's time.

        Raises:
            DeviceError: the arm is lost or refuses.
        """
        ...

    def stop(self) -> None:
        """Brake as fast as the drives allow and hold. Always works, may be repeated."""
        ...


class RgbdCamera(Protocol):
    """A camera that measures depth, and colour on demand."""

    @property
    def info(self) -> RgbdCameraInfo:
        """What is known of it."""
        ...

    def read(self) -> RgbdFrame | None:
        """The newest frame that has arrived since the last call, or None.

        Raises:
            DeviceError: the camera is lost.
        """
        ...

    def want_color(self, wanted: bool) -> None:
        """Ask for colour beside depth from now on, or spare it."""
        ...


class StereoCamera(Protocol):
    """Two colour lenses side by side."""

    @property
    def info(self) -> RgbdCameraInfo:
        """What is known of the left lens; ``T_depth_color`` is the right lens in the left."""
        ...

    def read(self) -> StereoFrame | None:
        """The newest pair that has arrived since the last call, or None."""
        ...


class ForceSensor(Protocol):
    """Force and torque at the flange."""

    def read(self) -> Wrench | None:
        """The newest reading, or None before the first."""
        ...


class Gripper(Protocol):
    """A two-finger gripper."""

    def move(self, width: float) -> None:
        """Open or close to a width [m]."""
        ...

    def width(self) -> float:
        """Present width [m]."""
        ...
