"""The component that reads the devices: what has arrived is passed on, what is lost is said."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

from armsight.devices.data import ArmStatus, StereoFrame, Wrench
from armsight.devices.protocols import Arm, RgbdCamera
from armsight.errors import DeviceError, DeviceLostError
from armsight.runtime.channels import Channels

ARM_GRACE = 0.5
"""A run ends when the arm has not answered for so long [s]."""


MOST_WAITING = 64
"""Readings of one sensor that are taken in a round."""


class Sensor(Protocol):
    """A device that is read like all others: a stereo pair, a force sensor, a gripper."""

    def read(self) -> Any:
        """The newest reading since the last call, or None."""
        ...


@runtime_checkable
class SensorTap(Protocol):
    """Sees every reading as it comes in, in sensing's thread: it must be quick and never raise."""

    def on_reading(self, reading: Any, now: float) -> None:
        """A reading of any device came in at ``now`` [s]; joints may come twice."""
        ...


class SensingComponent:
    """Reads every device. No read waits: a driver that may block has a thread of its own.

    A camera or another sensor that raises is counted dead, not fatal. Without its arm a run ends.

    Attributes:
        problem: what is wrong with the devices, in words.
        on_frames: called when pictures for the map have come.
        on_pictures: called when any pictures have come.
        taps: see every reading.
    """

    name = "sensing"

    def __init__(
        self,
        channels: Channels,
        arm: Arm,
        cameras: Sequence[RgbdCamera],
        sensors: Sequence[Sensor] = (),
        period: float = 0.004,
    ) -> None:
        self.period = period
        self.charge = 0.0
        self.problem = ""
        self.on_frames: Callable[[float], None] = lambda at: None
        self.on_pictures: Callable[[float], None] = lambda at: None
        self.taps: list[SensorTap] = []
        self._channels = channels
        self._arm = arm
        self._cameras = tuple(cameras)
        self._sensors = tuple(sensors)
        self._silent_since: float | None = None
        self._status: ArmStatus | None = None

    def update(self, now: float) -> None:
        """Pass on what has arrived.

        Raises:
            DeviceLostError: the arm has not answered for :data:`ARM_GRACE`, or is lost for good.
        """
        problems = self._read_arm(now)
        fresh = came = False
        for camera in self._cameras:
            try:
                frame = camera.read()
            except DeviceError as error:
                problems.append(str(error))
                continue
            if frame is not None:
                for_map = camera.info.guard
                self._channels.frames.put(frame, for_map)
                fresh, came = fresh or for_map, True
                self.tell(frame, now)
        for sensor in self._sensors:
            try:
                for reading in _waiting(sensor):
                    self._channels.readings.put(reading)
                    if isinstance(reading, Wrench):
                        self._channels.history.feel(reading)
                    if isinstance(reading, StereoFrame):
                        self._channels.frames.show(reading)
                        came = True
                    self.tell(reading, now)
            except DeviceError as error:
                problems.append(str(error))
        self.problem = "; ".join(problems)
        if fresh:
            self.on_frames(now)
        if came:
            self.on_pictures(now)

    def _read_arm(self, now: float) -> list[str]:
        """Joints and the controller's word; what is wrong with the arm, in words."""
        try:
            joints, status = self._arm.read(), self._arm.status
        except DeviceLostError as error:
            self.problem = str(error)
            raise
        except DeviceError as error:
            if self._silent_since is None:
                self._silent_since = now
            if now - self._silent_since > ARM_GRACE:
                self.problem = str(error)
                raise DeviceLostError(
                    f"{error} (the arm has not answered for {ARM_GRACE:g} s)"
                ) from error
            return [str(error)]
        self._silent_since = None
        if joints is not None:
            self._channels.history.add(joints)
            self._channels.joints.publish(joints, now)
            self.tell(joints, now)
        if status is None:
            return []
        self._channels.readings.put(status)
        last, self._status = self._status, status
        if last is None or _says(last) != _says(status):
            self.tell(status, now)
        return [] if status.obeys else [f"arm: {status}"]

    def tell(self, reading: Any, now: float) -> None:
        """Pass a reading on to the taps; also what somebody has said of the cell."""
        for tap in self.taps:
            tap.on_reading(reading, now)


def _waiting(sensor: Sensor) -> Iterator[Any]:
    """What a sensor has to say; some hand over every reading, others the newest alone."""
    for _ in range(MOST_WAITING):
        reading = sensor.read()
        if reading is None:
            return
        yield reading


def _says(status: ArmStatus) -> tuple[str, float, str]:
    return status.mode, status.speed, status.message
