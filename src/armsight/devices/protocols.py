"""What the rest of armsight may ask of a device, whichever driver stands behind it.

A driver is simulated, recorded or real; nothing outside ``devices`` and ``simulation`` can tell.
"""

from __future__ import annotations

from typing import Protocol

from armsight.arrays import JointVector
from armsight.devices.data import (
    ArmStatus,
    GripperState,
    JointState,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
    SwitchState,
    Wrench,
)


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

    @property
    def status(self) -> ArmStatus | None:
        """The controller's newest word on itself; None where it says nothing."""
        ...

    def read(self) -> JointState | None:
        """The newest reading that has arrived, or None before the first.

        Raises:
            DeviceLostError: the arm is lost for good.
            DeviceError: it does not answer just now.
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
        """Brake as fast as the drives allow and hold; may be repeated, from any thread.

        Raises:
            DeviceError: it cannot be told. The arm's own watchdog has to stop it.
        """
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

    def want_color(self, rate: float, scale: float = 1.0) -> None:
        """Ask for colour beside depth from the next exposure on, or spare it.

        Args:
            rate: pictures wanted a second at least [Hz]; 0 spares colour, more than the camera's
                rate means every exposure.
            scale: edge of the picture in shares of the colour lens's own, above 0 to 1. A device
                that cannot scale may send more; the picture's own size tells.
        """
        ...


class StereoCamera(Protocol):
    """Two colour lenses side by side."""

    @property
    def info(self) -> StereoInfo:
        """What is known of it."""
        ...

    def read(self) -> StereoFrame | None:
        """The newest pair that has arrived since the last call, or None; None while not wanted.

        Raises:
            DeviceError: the pair is lost.
        """
        ...

    def want_pictures(self, wanted: bool) -> None:
        """Ask for pairs from now on, or spare them: they cost bandwidth, and simulated ones time.

        None are wanted at first.
        """
        ...


class ForceSensor(Protocol):
    """Force and torque at the flange, the tool's weight included."""

    def read(self) -> Wrench | None:
        """A reading that has arrived since the last call, or None.

        The newest, or the oldest that was not handed over yet: whoever wants all asks until there
        is none.

        Raises:
            DeviceError: the sensor is lost.
        """
        ...


class Gripper(Protocol):
    """A two-finger gripper."""

    @property
    def opening(self) -> float:
        """Greatest width [m]."""
        ...

    def move(self, width: float) -> None:
        """Begin to open or close to a width [m].

        Raises:
            DeviceError: there is no such width, or the gripper is lost.
        """
        ...

    def read(self) -> GripperState | None:
        """The newest state that has arrived since the last call, or None.

        Raises:
            DeviceError: the gripper is lost.
        """
        ...


class Switch(Protocol):
    """A switch that somebody turns who has seen that nobody is in the cell."""

    def read(self) -> SwitchState | None:
        """The newest state that has arrived since the last call, or None.

        Raises:
            DeviceError: the switch is lost.
        """
        ...
