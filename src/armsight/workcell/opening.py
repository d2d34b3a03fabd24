"""Opens the devices behind drivers, and closes them so that none can hold up the others."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol, runtime_checkable

from armsight.arrays import Pose
from armsight.devices.clock import WallClock
from armsight.devices.data import RgbdCameraInfo, StereoInfo
from armsight.devices.driven_arm import DrivenArm
from armsight.devices.driven_cameras import DrivenCamera, DrivenStereo
from armsight.devices.driven_hand import DrivenGripper, DrivenWrench
from armsight.devices.driven_switch import DrivenSwitch
from armsight.devices.line import STOP_SECONDS, DeviceHealth
from armsight.devices.port import (
    ArmSettings,
    CameraReport,
    CameraSettings,
    GripperSettings,
    StereoReport,
    SwitchSettings,
    WrenchSettings,
)
from armsight.errors import DeviceError
from armsight.robots.robot import Robot
from armsight.workcell.calibration_file.reading import mount_pose
from armsight.workcell.drivers import find_driver
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import (
    CameraSection,
    EmptySwitchSection,
    GripperSection,
    MountedSection,
    RobotSection,
    StereoSection,
    WrenchSection,
)

log = logging.getLogger(__name__)


@runtime_checkable
class Driven(Protocol):
    """A device behind a driver."""

    def health(self) -> DeviceHealth:
        """How it is."""
        ...

    def close(self) -> None:
        """Let go of it.

        Raises:
            DeviceError: its driver hung or raised.
        """
        ...


def open_arm(section: RobotSection, robot: Robot, clock: WallClock) -> DrivenArm:
    """Open the arm; errors as of :class:`~armsight.devices.driven_arm.DrivenArm`."""
    settings = ArmSettings(
        name=robot.name,
        connection=section.connection,
        joint_names=robot.joint_names,
        velocity=robot.limits.velocity * section.speed,
        acceleration=robot.limits.acceleration * section.acceleration,
        rate=section.state_rate_hz,
        watchdog=section.watchdog_ms / 1e3,
    )
    opener = find_driver("arm", section.driver)
    return DrivenArm(settings, robot.limits, opener, clock, section.state_latency_ms / 1e3)


def open_camera(
    workcell: Workcell,
    section: CameraSection,
    clock: WallClock,
    believe: Callable[[RgbdCameraInfo], RgbdCameraInfo] = lambda info: info,
) -> DrivenCamera:
    """Open a depth camera.

    Args:
        workcell: the cell.
        section: the camera's own.
        clock: of the cell.
        believe: corrects what the driver reports and the file declares by a calibration.
    """
    latency = None if section.latency_ms is None else section.latency_ms / 1e3
    return DrivenCamera(
        CameraSettings(section.name, section.connection, section.rate_hz),
        find_driver("camera", section.driver),
        lambda report: believe(_declared(workcell, section, report)),
        clock,
        latency,
    )


def open_stereo(
    workcell: Workcell,
    section: StereoSection,
    clock: WallClock,
    believe: Callable[[StereoInfo], StereoInfo] = lambda info: info,
) -> DrivenStereo:
    """Open a stereo pair; see :func:`open_camera`."""

    def describe(report: StereoReport) -> StereoInfo:
        mount, T = mounting(workcell, section)
        declared = StereoInfo(
            section.name,
            section.model or report.model,
            report.left,
            report.right,
            report.T_left_right,
            mount,
            T,
            report.rate,
            report.latency if latency is None else latency,
        )
        return believe(declared)

    latency = None if section.latency_ms is None else section.latency_ms / 1e3
    settings = CameraSettings(section.name, section.connection, section.rate_hz)
    return DrivenStereo(settings, find_driver("stereo", section.driver), describe, clock, latency)


def open_switch(section: EmptySwitchSection, clock: WallClock) -> DrivenSwitch:
    """Open the switch that says that the cell is empty."""
    settings = SwitchSettings(section.connection, section.rate_hz)
    return DrivenSwitch(settings, find_driver("switch", section.driver), clock)


def open_wrench(section: WrenchSection, clock: WallClock) -> DrivenWrench:
    """Open the force sensor."""
    settings = WrenchSettings(section.connection, section.rate_hz)
    return DrivenWrench(settings, find_driver("wrench", section.driver), clock)


def open_gripper(section: GripperSection, clock: WallClock) -> DrivenGripper:
    """Open the gripper."""
    settings = GripperSettings(section.connection, section.opening, section.speed, section.force_n)
    return DrivenGripper(settings, find_driver("gripper", section.driver), clock)


def mounting(workcell: Workcell, section: MountedSection) -> tuple[str, Pose]:
    """Where the file puts a lens: on ``base`` or ``flange``, and its pose there."""
    return "base" if section.mounted_on == "world" else "flange", mount_pose(workcell, section)


def _declared(workcell: Workcell, section: CameraSection, report: CameraReport) -> RgbdCameraInfo:
    mount, T = mounting(workcell, section)
    info = RgbdCameraInfo(
        name=section.name,
        model=section.model or report.model,
        depth=report.depth,
        color=report.color,
        T_depth_color=report.T_depth_color,
        mounted_on=mount,
        T_mount_camera=T,
        rate=report.rate,
        latency=report.latency,
        range=report.range,
        noise=report.noise,
        guard=section.guard,
        infrared_scale=report.infrared_scale,
    )
    return info if section.latency_ms is None else replace(info, latency=section.latency_ms / 1e3)


def close_all(devices: Iterable[object]) -> list[DeviceError]:
    """Close what is behind drivers, all at the same time; what went wrong with whom."""
    errors: list[DeviceError] = []

    def close(device: Driven) -> None:
        try:
            device.close()
        except DeviceError as error:
            errors.append(error)

    threads = [
        threading.Thread(target=close, args=(device,), daemon=True)
        for device in devices
        if isinstance(device, Driven)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(4 * STOP_SECONDS)
    for error in errors:
        log.warning("%s", error)
    return errors
