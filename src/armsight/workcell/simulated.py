"""A cell's file as the simulated world that it describes, in world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.devices.camera_models import camera_info
from armsight.errors import WorkcellError
from armsight.geometry.pose import from_rpy
from armsight.robots.catalogue import load_robot
from armsight.simulation.spec import (
    ArmSpec,
    CameraSpec,
    GripperSpec,
    MovingObjectSpec,
    PersonSpec,
    StandingArmSpec,
    WorldSpec,
    WrenchSpec,
)
from armsight.simulation.targets import TargetSpec, target_object
from armsight.workcell.beliefs import camera_info_of, robot_in
from armsight.workcell.board import board_spec
from armsight.workcell.calibration_file.reading import (
    mount_pose,
)
from armsight.workcell.calibration_file.schema import CellCalibration
from armsight.workcell.car import plug_spec, socket_spec
from armsight.workcell.drivers import SIMULATED
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import CameraSection, StereoSection
from armsight.workcell.schema_things import (
    ObjectSection,
    PersonSection,
    StandingArmSection,
    TargetSection,
)

DEFAULT_STEREO = "wrist_stereo"
"""Model of a simulated pair that names none."""


def world_spec(workcell: Workcell, calibration: CellCalibration | None = None) -> WorldSpec:
    """The simulated cell, in world.

    Args:
        workcell: the cell.
        calibration: what its cameras are believed to be; the truth is drawn without it.

    Raises:
        WorkcellError: the arm would begin outside of the joint limits that the file states.
    """
    section, settings = workcell.robot, workcell.simulation
    robot = robot_in(workcell)
    limits, home = robot.limits, robot.home
    outside = np.maximum(limits.lower - home, home - limits.upper) > 1e-9
    if section.driver == SIMULATED and outside.any():
        raise WorkcellError(
            f"{workcell.file or workcell.name}: robot.home_deg: the arm's own home, "
            f"{np.rad2deg(home).round(1).tolist()}, lies outside of joint_lower_deg and "
            "joint_upper_deg, and a simulated arm begins there: state another"
        )
    arm = ArmSpec(
        robot=robot,
        T_world_base=section.T_world_base,
        home=robot.home,
        start_delay=section.start_delay_ms / 1e3,
        state_latency=section.state_latency_ms / 1e3,
        state_rate=section.state_rate_hz,
        watchdog=section.watchdog_ms / 1e3,
        speed=section.speed,
        acceleration=section.acceleration,
        repeatability=settings.arm_repeatability_mm / 1e3,
        kinematic_error=settings.arm_kinematic_error,
    )
    return WorldSpec(
        arm=arm,
        cameras=tuple(
            _camera(workcell, c, calibration) for c in workcell.camera if c.driver == SIMULATED
        ),
        static=tuple(s.solid for s in workcell.solid),
        undeclared=tuple(s.solid for s in settings.undeclared),
        arms=tuple(_standing(a) for a in settings.arm),
        people=tuple(_person(workcell, p) for p in settings.person),
        objects=(
            *(_object(o) for o in settings.object),
            *(target_object(_target(t)) for t in settings.target),
        ),
        floor=settings.floor,
        time_step=(settings.time_step_ms or (1.0 if settings.contact_pushes else 2.0)) / 1e3,
        stereo=tuple(
            _pair(workcell, s, calibration) for s in workcell.stereo if s.driver == SIMULATED
        ),
        wrench=_wrench(workcell),
        gripper=_gripper(workcell),
        board=board_spec(workcell),
        pushes=settings.contact_pushes,
        plug=plug_spec(workcell),
        socket=socket_spec(workcell),
    )


def _standing(section: StandingArmSection) -> StandingArmSpec:
    robot = load_robot(section.model)
    given = section.joints_deg
    q = robot.home if given is None else np.deg2rad(given)
    T = from_rpy(np.deg2rad(section.rpy_deg), section.position)
    return StandingArmSpec(section.name, robot, T, q)


def _camera(
    workcell: Workcell, section: CameraSection, calibration: CellCalibration | None
) -> CameraSpec:
    settings = workcell.simulation
    return CameraSpec(
        info=camera_info_of(workcell, section, calibration),
        T_mount_camera_declared=section.T_mount_camera,
        declared=camera_info_of(workcell, section),
        errors=settings.sensor_errors,
        pose_error=(
            settings.calibration_error_mm / 1e3,
            float(np.deg2rad(settings.calibration_error_deg)),
        ),
        lens_error=settings.lens_error,
        stamp_jitter=settings.stamp_jitter_ms / 1e3,
        phase=section.phase_ms / 1e3,
        systematic=settings.depth_error,
    )


def _pair(
    workcell: Workcell, section: StereoSection, calibration: CellCalibration | None
) -> CameraSpec:
    """A simulated pair: its left lens is ``depth``, its right lens ``color``."""
    settings = workcell.simulation
    mount = "base" if section.mounted_on == "world" else "flange"
    declared = camera_info(
        section.name,
        section.model or DEFAULT_STEREO,
        mount,
        mount_pose(workcell, section),
        rate=section.rate_hz,
        latency=None if section.latency_ms is None else section.latency_ms / 1e3,
        ideal_lens=not settings.sensor_errors,
    )
    found = None if calibration is None else calibration.of_pair(section.name)
    info = declared
    if found is not None:
        info = replace(declared, T_mount_camera=found.pose, covariance=found.C)
    return CameraSpec(
        info=info,
        declared=declared,
        T_mount_camera_declared=section.T_mount_camera,
        errors=False,
        pose_error=(
            settings.calibration_error_mm / 1e3,
            float(np.deg2rad(settings.calibration_error_deg)),
        ),
        lens_error=settings.lens_error,
        stamp_jitter=settings.stamp_jitter_ms / 1e3,
    )


def _wrench(workcell: Workcell) -> WrenchSpec | None:
    section, errors = workcell.wrench, workcell.simulation.wrench
    if section is None or section.driver != SIMULATED:
        return None
    on = float(workcell.simulation.sensor_errors)
    return WrenchSpec(
        rate=section.rate_hz,
        noise=(on * errors.noise_n, on * errors.noise_nm),
        bias=(on * errors.bias_n, on * errors.bias_nm),
        low_pass=errors.low_pass_hz,
        latency=errors.latency_ms / 1e3,
        drift=(on * errors.drift_n, on * errors.drift_nm),
        greatest=(errors.greatest_n, errors.greatest_nm),
    )


def _gripper(workcell: Workcell) -> GripperSpec | None:
    section = workcell.gripper
    if section is None or section.driver != SIMULATED:
        return None
    return GripperSpec(section.opening, section.speed, force=section.force_n)


def _object(section: ObjectSection) -> MovingObjectSpec:
    return MovingObjectSpec(
        section.solid,
        section.path,
        section.center or (0.0, 0.0, 0.0),
        section.period_s,
        mass=section.mass_kg,
        surface=1e3 * section.surface_n_per_mm,
        hold=1e3 * section.hold_n_per_mm,
        held_by=section.held_by or "",
        carried_by=section.carried_by or "",
    )


def _person(workcell: Workcell, section: PersonSection) -> PersonSpec:
    clip = None
    if section.clip is not None:
        clip = workcell.file.parent / section.clip if workcell.file is not None else None
    return PersonSpec(
        name=section.name,
        motion=section.motion,
        T_world_person=section.T_world_person,
        script=section.script,
        clip=clip,
        period=section.period_s,
        start=section.start_s,
        speed_scale=section.speed_scale,
        max_hand_speed=section.max_hand_speed,
        mirror=section.mirror,
        height=section.height,
        target=section.target,
        distance=section.distance,
    )


def _target(section: TargetSection) -> TargetSpec:
    return TargetSpec(
        name=section.name,
        kind=section.kind,
        T_world_target=section.pose,
        path=section.path,
        center=section.center or (0.0, 0.0, 0.0),
        period=section.period_s,
        speed=section.speed,
        room=section.room,
        glossy=section.glossy,
        mass=section.mass_kg,
        surface=1e3 * section.surface_n_per_mm,
    )
