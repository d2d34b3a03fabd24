"""Which drivers there are. Real ones plug in through the entry-point group ``armsight.drivers``.

A driver package declares, in its ``pyproject.toml``::

    [project.entry-points."armsight.drivers"]
    ur_rtde = "armsight_ur:Driver"

and the cell file then says ``driver = "ur_rtde"``. The object named there is called without
arguments and must satisfy :class:`Driver`.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from armsight.devices.data import RgbdCameraInfo
from armsight.devices.protocols import Arm, Clock, RgbdCamera
from armsight.errors import DeviceError
from armsight.robots.robot import Robot
from armsight.workcell.problems import nearest
from armsight.workcell.schema import CameraSection, RobotSection

GROUP = "armsight.drivers"
SIMULATED = "simulated"


class Driver(Protocol):
    """Opens real devices. What it opens may have a ``close()``, which the cell calls at its end."""

    def open_arm(self, settings: RobotSection, robot: Robot, clock: Clock) -> Arm:
        """Connect to the arm.

        Raises:
            DeviceError: it is not there, or refuses.
        """
        ...

    def open_camera(
        self, settings: CameraSection, info: RgbdCameraInfo, clock: Clock
    ) -> RgbdCamera:
        """Connect to a camera; ``info`` is what the catalogue and the cell say of it.

        Raises:
            DeviceError: it is not there, or says something that cannot be.
        """
        ...


@cache
def _plugged_in() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def driver_names() -> tuple[str, ...]:
    """``simulated`` and every driver that is installed."""
    return (SIMULATED, *sorted(_plugged_in()))


def real_driver(name: str) -> Driver:
    """The plugged-in driver of a name.

    Raises:
        DeviceError: there is none, or its package is broken.
    """
    entry = _plugged_in().get(name)
    if entry is None:
        raise DeviceError(
            f'unknown driver "{name}"; {nearest(name, driver_names())} '
            f"(real drivers plug in through the entry points {GROUP})"
        )
    try:
        driver: Driver = entry.load()()
    except Exception as error:  # a foreign package may fail in any way
        raise DeviceError(
            f'driver "{name}" ({entry.value}) cannot be loaded: {type(error).__name__}: {error}'
        ) from error
    return driver
