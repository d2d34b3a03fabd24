"""What a cell believes of its arm and its cameras: as declared, or as calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.camera_models import camera_info
from armsight.devices.data import RgbdCameraInfo
from armsight.errors import WorkcellError
from armsight.geometry.pose import inverse, transform
from armsight.robots.cable import HungCable
from armsight.robots.robot import Robot
from armsight.robots.soft_mount import SoftMount
from armsight.robots.sprung_tip import SprungTip
from armsight.workcell.calibration_file.reading import (
    calibrated_info,
    mount_pose,
)
from armsight.workcell.calibration_file.schema import CellCalibration
from armsight.workcell.checks import robot_of
from armsight.workcell.drivers import SIMULATED
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import CameraSection, PlugSection

GRAVITY = 9.81
PORT_TORQUE = 15.0
"""With which a port may turn a plug at most [N m]."""


def robot_in(workcell: Workcell) -> Robot:
    """The cell's robot: with its tool, its home, and joint limits as narrow as the file says."""
    section = workcell.robot
    robot = with_tip(in_mount(robot_of(section, workcell.held), workcell), workcell)
    limits = robot.limits
    lower, upper = limits.lower, limits.upper
    if section.joint_lower_deg is not None:
        lower = np.maximum(lower, np.deg2rad(section.joint_lower_deg))
    if section.joint_upper_deg is not None:
        upper = np.minimum(upper, np.deg2rad(section.joint_upper_deg))
    return replace(
        robot, limits=replace(limits, lower=lower, upper=upper), home=_home(workcell, robot)
    )


def in_mount(robot: Robot, workcell: Workcell) -> Robot:
    """The robot whose plug hangs in the mount that the cell's file states, if it does."""
    plug, tool = workcell.plug, robot.tool
    if plug is None or tool is None:
        return robot
    stiffness = (1e3 * plug.mount_n_per_mm, plug.mount_nm_per_rad)
    tip, weight = tool.T_flange_tcp[:3, 3], GRAVITY * tool.mass
    # The cable leaves the plug no farther behind its tip than the flange is.
    turning = weight * np.linalg.norm(tool.center_of_mass - tip)
    rest = (weight + plug.cable_n, float(turning + plug.cable_n * np.linalg.norm(tip)))
    most = (workcell.guard.thing_force_n + rest[0], PORT_TORQUE + rest[1])
    mount = SoftMount(stiffness, most, rest)
    return replace(robot, tool=replace(tool, mount=mount, cable=_cable(workcell, plug)))


def with_tip(robot: Robot, workcell: Workcell) -> Robot:
    """The robot whose tool's tip gives way as the cell's file states, if it does.

    Raises:
        WorkcellError: there is no tool, or no force sensor to tell that the spring is at work.
    """
    tip, tool = tip_of(workcell), robot.tool
    if tip is None:
        return robot
    if tool is None or workcell.wrench is None:
        raise WorkcellError(
            f"{workcell.file or workcell.name}: [tip] needs a [wrench] and robot.tool: whose it is"
        )
    return replace(robot, tool=replace(tool, tip=tip))


def tip_of(workcell: Workcell) -> SprungTip | None:
    """How the cell's file says that the tool's tip gives way; None where it does not."""
    section = workcell.tip
    if section is None:
        return None
    return SprungTip(
        1e3 * section.spring_n_per_mm,
        1e-3 * section.travel_mm,
        section.seat_n,
        1e-3 * section.length_mm,
    )


def _cable(workcell: Workcell, plug: PlugSection) -> HungCable | None:
    if plug.hanger is None:
        return None
    x, y, z = transform(inverse(workcell.robot.T_world_base), np.array([plug.hanger]))[0]
    return HungCable(
        (float(x), float(y), float(z)),
        plug.cable_m,
        0.5e-3 * plug.cable_mm,
        mass=plug.cable_kg_per_m,
        bending=plug.cable_nm2,
    )


def camera_info_of(
    workcell: Workcell, section: CameraSection, calibration: CellCalibration | None = None
) -> RgbdCameraInfo:
    """What the cell believes of a camera: as it is declared, or as it was calibrated.

    Args:
        workcell: the cell.
        section: the camera's own.
        calibration: of the cell; None for what the workcell file declares.

    Raises:
        WorkcellError: the calibration is of a camera with another resolution.
    """
    ideal = section.driver == SIMULATED and not workcell.simulation.sensor_errors
    declared = camera_info(
        section.name,
        section.model or "",
        "base" if section.mounted_on == "world" else "flange",
        mount_pose(workcell, section),
        rate=section.rate_hz,
        latency=None if section.latency_ms is None else section.latency_ms / 1e3,
        ideal_lens=ideal,
        color_scale=workcell.simulation.color_scale if section.driver == SIMULATED else 1.0,
    )
    if not section.guard:
        declared = replace(declared, guard=False)
    return believed(declared, calibration)


def believed(declared: RgbdCameraInfo, calibration: CellCalibration | None) -> RgbdCameraInfo:
    """What is declared of a camera, corrected by its calibration if it has one.

    Raises:
        WorkcellError: the calibration is of a camera with another resolution.
    """
    found = None if calibration is None else calibration.of(declared.name)
    return declared if found is None else calibrated_info(declared, found)


def _home(workcell: Workcell, robot: Robot) -> JointVector:
    home = workcell.robot.home_deg
    return robot.home if home is None else np.deg2rad(home)
