"""The devices of a cell as a session uses them: whose clock counts, and who may touch what."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from armsight.devices.clock import WallClock
from armsight.devices.driven_arm import ArmRecipe, DrivenArm
from armsight.devices.protocols import Arm, Clock, RgbdCamera
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.runtime.command_link import CommandLink, movable
from armsight.runtime.config import SessionMode
from armsight.runtime.lock import arm_address, arm_lock, cell_lock
from armsight.runtime.remote_arm import RemoteArm
from armsight.runtime.sensing import Sensor
from armsight.runtime.shared_devices import UntouchedArm, shared_arm, shared_camera, shared_sensors

if TYPE_CHECKING:
    from armsight.workcell import Cell


class SessionDevices:
    """Clock, arm, cameras and sensors, shared between threads where there are any.

    Args:
        cell: whose they are.
        mode: how the session runs.

    Attributes:
        real: something of the cell is real, so its time is the computer's.
        wall: components run in threads under the wall clock.
        advance: moves the cell's own clock; None for a cell in real time.
        lock: held by whoever touches the simulation where threads do.
        clock, arm, cameras, sensors: the devices.
    """

    def __init__(self, cell: Cell, mode: SessionMode) -> None:
        self._cell = cell
        self.advance = _advance_of(cell)
        self.real = self.advance is None or cell.mixed
        self.wall = mode.wall or self.real
        self.lock = threading.RLock()
        self.clock: Clock = cell.clock
        self.arm: Arm = cell.arm
        self.cameras: Sequence[RgbdCamera] = cell.cameras
        self.sensors: Sequence[Sensor] = cell.sensors
        if self.wall and self.advance is not None:
            # The devices of a mixed cell are dated with its own clock, which can be paused.
            clock = cell.clock if isinstance(cell.clock, WallClock) else WallClock(cell.clock.now())
            clock.pause()
            self.clock = clock
            self.arm = shared_arm(cell.arm, self.lock)
            self.cameras = [shared_camera(c, self.lock) for c in cell.cameras]
            self.sensors = shared_sensors(cell.sensors, self.lock)
        if mode.look_only:
            self.arm = UntouchedArm(self.arm)

    def command_link(self, mode: SessionMode) -> CommandLink | None:
        """The process of the command path, in which the arm is from now on; None to stay here.

        Raises:
            DeviceError: the arm cannot be opened there.
        """
        arm, clock = self._cell.arm, self._cell.clock
        if not (self.wall and mode.own_process) or mode.look_only:
            return None
        if isinstance(arm, DrivenArm) and isinstance(clock, WallClock) and movable(arm.recipe):
            arm.close()
            arm = self._cell.arm = self.arm = RemoteArm(CommandLink(arm.recipe, clock))
        return arm.link if isinstance(arm, RemoteArm) else None

    @contextlib.contextmanager
    def running(self, held: bool) -> Iterator[None]:
        """A clock of our own (simulated cell, wall clock) stands still between runs."""
        clock = self.clock
        if not isinstance(clock, WallClock) or self.advance is None:
            yield
            return
        if not held:
            clock.resume()
        try:
            yield
        finally:
            clock.pause()

    def alone(self, exclusive: bool | None) -> contextlib.AbstractContextManager[None]:
        """Keeps other processes from the arm for as long as it lasts.

        Args:
            exclusive: see :class:`~armsight.runtime.config.SessionMode`.

        Raises:
            CellBusyError: another process has it.
        """
        name, recipe = self._cell.workcell.name, _recipe(self._cell.arm)
        if exclusive is None:  # an arm that is simulated beside real devices is nobody's
            exclusive = recipe is not None or (self.real and not self._cell.mixed)
        if not exclusive:
            return contextlib.nullcontext()
        if recipe is None:  # behind no driver: known by its cell alone
            return cell_lock(name)
        return arm_lock(arm_address(recipe.opener, recipe.settings.connection), name)

    def turn_back(self) -> None:
        """Back to time 0; only for a cell that is not real."""
        world = self._cell.world
        assert world is not None
        world.reset()
        if isinstance(self.clock, WallClock):
            self.clock.restart()

    def movers(self) -> tuple[tuple[MovingSolid, ...], tuple[MovingSurfaces, ...]]:
        """People and things that move, and what people look like, where a driver can show them."""
        world = self._cell.world
        if world is None:
            return (), ()
        with self.lock:
            return world.movers(), world.bodies()


def _advance_of(cell: Cell) -> Callable[[float], None] | None:
    """What moves the cell's own clock, or None for a cell in real time."""
    if cell.world is not None:
        return cell.world.advance
    advance: Callable[[float], None] | None = getattr(cell.clock, "advance", None)
    return advance


def _recipe(arm: Arm) -> ArmRecipe | None:
    """How an arm behind a driver is opened; None for others."""
    if isinstance(arm, DrivenArm):
        return arm.recipe
    return arm.link.arm if isinstance(arm, RemoteArm) else None
