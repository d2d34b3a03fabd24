"""Makes devices from a workcell: the one place where the file's world becomes base-frame data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, TypeVar

import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.devices.camera_models import camera_info
from armsight.devices.clock import WallClock
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.line import DeviceHealth
from armsight.devices.protocols import Arm, Clock, ForceSensor, Gripper, RgbdCamera, StereoCamera
from armsight.devices.world import World
from armsight.errors import DeviceError, UsageError
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.robots.robot import Robot
from armsight.simulation.spec import (
    ArmSpec,
    CameraSpec,
    GripperSpec,
    MovingObjectSpec,
    PersonSpec,
    WorldSpec,
    WrenchSpec,
)
from armsight.simulation.targets import TargetSpec, target_object
from armsight.simulation.world import SimulatedWorld
from armsight.workcell.board import board_spec
from armsight.workcell.calibration_file.reading import (
    calibrated_info,
    calibrated_robot,
    calibration_of,
    mount_pose,
)
from armsight.workcell.calibration_file.schema import CellCalibration
from armsight.workcell.checks import robot_of
from armsight.workcell.drivers import SIMULATED
from armsight.workcell.opening import (
    Driven,
    close_all,
    open_arm,
    open_camera,
    open_gripper,
    open_stereo,
    open_wrench,
)
from armsight.workcell.schema import (
    CameraSection,
    ObjectSection,
    PersonSection,
    StereoSection,
    TargetSection,
    Workcell,
)

DEFAULT_STEREO = "wrist_stereo"
"""Model of a simulated pair that names none."""

Device = TypeVar("Device")


@dataclass
class Cell:
    """An open cell: everything that the loop needs, whichever drivers stand behind it.

    Attributes:
        workcell: the file it came from.
        robot: with its tool, its home and the cell's joint limits.
        T_world_base: where the robot stands.
        clock: the cell's time.
        arm: commanded by the guard alone.
        cameras: in the file's order.
        static: declared solids, in the robot's ``base`` frame.
        world: the simulation or the recording behind the devices, or None.
        stereo: stereo pairs, in the file's order.
        wrench: the force sensor at the flange, or None; gripper: likewise.
        mixed: a simulation stands behind some of the devices, and time is the computer's.
        show_joints: shows a real arm's joints to the simulation behind the cameras, or None.
        calibration: what was believed when it was opened; None for a cell that has none.
    """

    workcell: Workcell
    robot: Robot
    T_world_base: Pose
    clock: Clock
    arm: Arm
    cameras: tuple[RgbdCamera, ...]
    static: tuple[Solid, ...]
    world: World | None = None
    _closed: bool = field(default=False, repr=False)
    stereo: tuple[StereoCamera, ...] = ()
    wrench: ForceSensor | None = None
    gripper: Gripper | None = None
    mixed: bool = False
    show_joints: Callable[[JointVector], None] | None = None
    calibration: CellCalibration | None = None

    @property
    def simulated(self) -> bool:
        """Whether time is not the computer's: a simulation or a recording stands behind."""
        return self.world is not None and not self.mixed

    @property
    def sensors(self) -> tuple[StereoCamera | ForceSensor | Gripper, ...]:
        """Everything that is read besides the arm and the depth cameras."""
        hand = (self.wrench, self.gripper)
        return (*self.stereo, *(device for device in hand if device is not None))

    @property
    def guard_cameras(self) -> list[RgbdCameraInfo]:
        """The cameras whose pictures are evidence for the map and the guard."""
        return [camera.info for camera in self.cameras if camera.info.guard]

    def health(self) -> tuple[DeviceHealth, ...]:
        """How the devices behind drivers are."""
        devices = (self.arm, *self.cameras, *self.sensors)
        return tuple(device.health() for device in devices if isinstance(device, Driven))

    def close(self) -> None:
        """Let go of every device, an arm that was commanded stopped before; may be repeated.

        Raises:
            DeviceError: a driver hung or raised; the others are closed all the same.
        """
        if self._closed:
            return
        self._closed = True
        errors = close_all((self.arm, *self.cameras, *self.sensors))
        if self.world is not None:
            self.world.close()
        if errors:
            raise errors[0]

    def __enter__(self) -> Cell:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except DeviceError:  # it has been logged; what ended the run goes first
            if error is None:
                raise


def open_cell(
    workcell: Workcell, seed: int = 0, clock: WallClock | None = None, *, calibrated: bool = True
) -> Cell:
    """Open every device of a cell.

    Simulated and real devices mix: time is then the computer's, and the simulation keeps up with
    it. Cameras that are simulated beside a real arm see it where it says it is.

    Args:
        workcell: from :func:`~armsight.workcell.load_workcell`.
        seed: of the simulation's randomness; real devices have none.
        clock: for real devices, else one that starts now; a simulation brings its own.
        calibrated: believe the cell's calibration file, where there is one; else only what the
            workcell file declares.

    Raises:
        DeviceError: a device is missing or refuses; those opened before it are closed again.
        WorkcellError: the calibration is not this cell's.
    """
    calibration = calibration_of(workcell) if calibrated else None
    robot = calibrated_robot(robot_in(workcell), calibration)
    simulated = [section.driver == SIMULATED for section in _device_sections(workcell)]
    world = SimulatedWorld(world_spec(workcell, calibration), seed) if any(simulated) else None
    mixed = world is not None and not all(simulated)
    clock = clock or WallClock()
    opened: list[object] = []

    def believe(declared: RgbdCameraInfo) -> RgbdCameraInfo:
        return believed(declared, calibration)

    def keep(device: Device) -> Device:
        opened.append(device)
        return device

    cameras = {} if world is None else {c.info.name: c for c in world.cameras}
    pairs = {} if world is None else {p.info.name: p for p in world.stereo_cameras}
    own_arm = workcell.robot.driver == SIMULATED
    arm: Arm
    wrench: ForceSensor | None = None if world is None else world.wrench
    gripper: Gripper | None = None if world is None else world.gripper
    try:
        if world is not None and own_arm:
            arm = world.arm
        else:
            arm = keep(open_arm(workcell.robot, robot, clock))
        if workcell.wrench is not None and wrench is None:
            wrench = keep(open_wrench(workcell.wrench, clock))
        if workcell.gripper is not None and gripper is None:
            gripper = keep(open_gripper(workcell.gripper, clock))
        return Cell(
            workcell,
            robot,
            workcell.robot.T_world_base,
            world.clock if world is not None and not mixed else clock,
            arm,
            tuple(
                cameras.get(c.name) or keep(open_camera(workcell, c, clock, believe))
                for c in workcell.camera
            ),
            tuple(_in_base(s.solid, workcell.robot.T_world_base) for s in workcell.solid),
            world,
            stereo=tuple(
                pairs.get(s.name) or keep(open_stereo(workcell, s, clock)) for s in workcell.stereo
            ),
            wrench=wrench,
            gripper=gripper,
            mixed=mixed,
            show_joints=None if world is None or own_arm else world.show_joints,
            calibration=calibration,
        )
    except BaseException:
        close_all(opened)
        if world is not None:
            world.close()
        raise


def _device_sections(workcell: Workcell) -> list[Any]:
    """Every table of the file that has a driver."""
    hand = [section for section in (workcell.wrench, workcell.gripper) if section is not None]
    return [workcell.robot, *workcell.camera, *workcell.stereo, *hand]


def simulated_world(cell: Cell) -> SimulatedWorld:
    """The simulation behind a cell: for experiments and their scoring, never for a capability.

    Raises:
        UsageError: the cell is real or recorded.
    """
    if not isinstance(cell.world, SimulatedWorld):
        raise UsageError(f"{cell.workcell.name}: only a simulated cell has a truth to score by")
    return cell.world


def robot_in(workcell: Workcell) -> Robot:
    """The cell's robot: with its tool, its home, and joint limits as narrow as the file says."""
    section = workcell.robot
    robot = robot_of(section)
    limits = robot.limits
    lower, upper = limits.lower, limits.upper
    if section.joint_lower_deg is not None:
        lower = np.maximum(lower, np.deg2rad(section.joint_lower_deg))
    if section.joint_upper_deg is not None:
        upper = np.minimum(upper, np.deg2rad(section.joint_upper_deg))
    return replace(
        robot, limits=replace(limits, lower=lower, upper=upper), home=_home(workcell, robot)
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


def world_spec(workcell: Workcell, calibration: CellCalibration | None = None) -> WorldSpec:
    """The simulated cell, in world.

    Args:
        workcell: the cell.
        calibration: what its cameras are believed to be; the truth is drawn without it.
    """
    section, settings = workcell.robot, workcell.simulation
    robot = robot_in(workcell)
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
        people=tuple(_person(workcell, p) for p in settings.person),
        objects=(
            *(_object(o) for o in settings.object),
            *(target_object(_target(t)) for t in settings.target),
        ),
        floor=settings.floor,
        time_step=(settings.time_step_ms or (1.0 if settings.contact_pushes else 2.0)) / 1e3,
        stereo=tuple(_pair(workcell, s) for s in workcell.stereo if s.driver == SIMULATED),
        wrench=_wrench(workcell),
        gripper=_gripper(workcell),
        board=board_spec(workcell),
        pushes=settings.contact_pushes,
    )


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


def _pair(workcell: Workcell, section: StereoSection) -> CameraSpec:
    """A simulated pair: its left lens is ``depth``, its right lens ``color``."""
    settings = workcell.simulation
    mount = "base" if section.mounted_on == "world" else "flange"
    return CameraSpec(
        info=camera_info(
            section.name,
            section.model or DEFAULT_STEREO,
            mount,
            mount_pose(workcell, section),
            rate=section.rate_hz,
            latency=None if section.latency_ms is None else section.latency_ms / 1e3,
            ideal_lens=not settings.sensor_errors,
        ),
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
    )


def _home(workcell: Workcell, robot: Robot) -> JointVector:
    home = workcell.robot.home_deg
    return robot.home if home is None else np.deg2rad(home)


def _in_base(solid: Solid, T_world_base: Pose) -> Solid:
    return replace(solid, T_frame_solid=inverse(T_world_base) @ solid.T_frame_solid)
