"""Makes devices from a workcell: the one place where the file's world becomes base-frame data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, TypeVar

from armsight.arrays import JointVector, Pose
from armsight.devices.clock import WallClock
from armsight.devices.data import RgbdCameraInfo, StereoInfo
from armsight.devices.line import DeviceHealth
from armsight.devices.protocols import (
    Arm,
    Clock,
    ForceSensor,
    Gripper,
    RgbdCamera,
    StereoCamera,
    Switch,
)
from armsight.devices.world import World
from armsight.errors import DeviceError, UsageError
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.robots.robot import Robot
from armsight.simulation.world import SimulatedWorld
from armsight.workcell.beliefs import believed, robot_in
from armsight.workcell.calibration_file.reading import (
    calibrated_pair,
    calibrated_robot,
    calibration_of,
)
from armsight.workcell.calibration_file.schema import CellCalibration
from armsight.workcell.drivers import SIMULATED
from armsight.workcell.opening import (
    Driven,
    close_all,
    open_arm,
    open_camera,
    open_gripper,
    open_stereo,
    open_switch,
    open_wrench,
)
from armsight.workcell.schema import Workcell
from armsight.workcell.simulated import world_spec

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
        empty_switch: what says that nobody is in the cell, or None.
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
    empty_switch: Switch | None = None
    mixed: bool = False
    show_joints: Callable[[JointVector], None] | None = None
    calibration: CellCalibration | None = None

    @property
    def simulated(self) -> bool:
        """Whether time is not the computer's: a simulation or a recording stands behind."""
        return self.world is not None and not self.mixed

    @property
    def sensors(self) -> tuple[StereoCamera | ForceSensor | Gripper | Switch, ...]:
        """Everything that is read besides the arm and the depth cameras."""
        others = (self.wrench, self.gripper, self.empty_switch)
        return (*self.stereo, *(device for device in others if device is not None))

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
    workcell: Workcell,
    seed: int = 0,
    clock: WallClock | None = None,
    *,
    calibrated: bool = True,
    by_plug: bool = True,
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
        by_plug: with what ``calibrate --plug`` has found.

    Raises:
        DeviceError: a device is missing or refuses; those opened before it are closed again.
        WorkcellError: the calibration is not this cell's.
    """
    calibration = calibration_of(workcell, by_plug) if calibrated else None
    robot = calibrated_robot(robot_in(workcell), calibration)
    simulated = [section.driver == SIMULATED for section in _device_sections(workcell)]
    world = SimulatedWorld(world_spec(workcell, calibration), seed) if any(simulated) else None
    mixed = world is not None and not all(simulated)
    clock = clock or WallClock()
    opened: list[object] = []

    def believe(declared: RgbdCameraInfo) -> RgbdCameraInfo:
        return believed(declared, calibration)

    def believe_pair(declared: StereoInfo) -> StereoInfo:
        return calibrated_pair(declared, calibration)

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
        switch = None
        if workcell.empty_switch is not None:
            switch = keep(open_switch(workcell.empty_switch, clock))
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
            solids_in_base(workcell),
            world,
            stereo=tuple(
                pairs.get(s.name) or keep(open_stereo(workcell, s, clock, believe_pair))
                for s in workcell.stereo
            ),
            wrench=wrench,
            gripper=gripper,
            empty_switch=switch,
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
    others = (workcell.wrench, workcell.gripper, workcell.empty_switch)
    there = [section for section in others if section is not None]
    return [workcell.robot, *workcell.camera, *workcell.stereo, *there]


def simulated_world(cell: Cell) -> SimulatedWorld:
    """The simulation behind a cell: for experiments and their scoring, never for a capability.

    Raises:
        UsageError: the cell is real or recorded.
    """
    if not isinstance(cell.world, SimulatedWorld):
        raise UsageError(f"{cell.workcell.name}: only a simulated cell has a truth to score by")
    return cell.world


def solids_in_base(workcell: Workcell) -> tuple[Solid, ...]:
    """What the cell's file declares, placed in ``base``."""
    T = inverse(workcell.robot.T_world_base)
    declared = (section.solid for section in workcell.solid)
    return tuple(replace(s, T_frame_solid=T @ s.T_frame_solid) for s in declared)
