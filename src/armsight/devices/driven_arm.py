"""An arm behind a driver: read and commanded with deadlines, believed only where it can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.clock import WallClock
from armsight.devices.clock_map import ClockMap
from armsight.devices.data import ArmMode, ArmStatus, JointState
from armsight.devices.line import DeviceHealth, Line
from armsight.devices.port import ArmDriver, ArmReading, ArmSettings
from armsight.errors import DeviceError
from armsight.robots.robot import JointLimits

COMMAND_SECONDS = 0.25
"""A command has to be taken in this time [s]."""
READ_SECONDS = 0.25
"""A read that has not returned in this time has hung [s]."""
SILENCE = 0.5
"""An arm that has nothing new for so long is lost [s]."""
BEYOND = 0.2
"""Joints may read so far outside their limits [rad]: an arm may have been pushed there."""
JUMP = (0.05, 2.0)
"""Between two readings joints move less than this [rad] and so many times their greatest speed."""


@dataclass(frozen=True)
class ArmRecipe:
    """All that it takes to open an arm, here or in another process; see :class:`DrivenArm`."""

    settings: ArmSettings
    limits: JointLimits
    opener: Callable[[ArmSettings], ArmDriver]
    latency: float = 0.0

    def open(self, clock: WallClock) -> DrivenArm:
        """Open the arm; errors as of :class:`DrivenArm`."""
        return DrivenArm(self.settings, self.limits, self.opener, clock, self.latency)


class DrivenArm:
    """Implements :class:`armsight.devices.protocols.Arm` over a driver of the port.

    Commands are held to the cell's speeds and sent by the device's thread; the arm is told to stop
    when none came for its watchdog's time. A lost arm is not opened again: whoever runs the cell
    has to end.
    """

    def __init__(
        self,
        settings: ArmSettings,
        limits: JointLimits,
        opener: Callable[[ArmSettings], ArmDriver],
        clock: WallClock,
        latency: float = 0.0,
    ) -> None:
        """Open the arm.

        Args:
            settings: for the driver.
            limits: of the robot, to tell what cannot be.
            opener: the driver's class.
            clock: the cell's.
            latency: of its readings [s].

        Raises:
            DeviceError: it cannot be opened.
        """
        self.name = f"arm {settings.name}"
        self.recipe = ArmRecipe(settings, limits, opener, latency)
        self._settings = settings
        self._limits = limits
        self._clock = clock
        self._map = ClockMap(self.name, latency)
        self._last: tuple[float | None, JointVector, float] | None = None
        self._status: ArmStatus | None = None
        self._commanded = -np.inf
        self._stops = 0
        self.touched = False
        self._line: Line[ArmDriver, JointState] = Line(
            self.name,
            lambda: opener(settings),
            self._take,
            deadline=READ_SECONDS,
            silence=SILENCE,
            pause=0.5 / settings.rate,
            reopen=False,
            now=clock.source,
        )
        self._line.wait_open()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._settings.joint_names

    @property
    def status(self) -> ArmStatus | None:
        """The controller's newest word; None before the first reading."""
        status = self._status
        if status is None:
            return None
        at = self._clock.at(status.stamp)
        return ArmStatus(at, status.mode, status.speed, status.message)

    def read(self) -> JointState | None:
        """The newest reading; None before the first.

        Raises:
            DeviceError: the arm is lost.
        """
        self._line.check()
        state = self._line.newest.peek()
        if state is None:
            return None
        at = self._clock.at(state.stamp)
        return JointState(at, state.position, state.velocity, state.effort)

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Ask for (n,) velocities [rad/s]; returns them as sent, slowed as one to keep direction.

        A command that is still on its way when somebody stops the arm is not sent, or stopped.

        Raises:
            DeviceError: the arm is lost or refuses, or the command is not n finite numbers, or the
                arm was told to stop meanwhile.
        """
        wanted = np.array(velocity, float)
        n = len(self.joint_names)
        if wanted.shape != (n,) or not np.all(np.isfinite(wanted)):
            raise DeviceError(
                f"{self.name}: a velocity command is {n} finite numbers in rad/s, not {velocity!r}"
            )
        excess = float(np.max(np.abs(wanted) / self._settings.velocity, initial=0.0))
        asked = wanted / excess if excess > 1.0 else wanted
        self.touched = True
        stops = self._stops

        def send(driver: ArmDriver) -> object:
            if stops != self._stops:
                raise DeviceError(f"{self.name}: it was told to stop before a command was sent")
            self._commanded = self._clock.source() if np.any(asked) else -np.inf
            said = driver.command_velocity(asked.copy())
            if stops != self._stops:  # nobody knows which of the two the arm heard last
                driver.stop()
            return said

        said = self._line.call("command_velocity()", send, COMMAND_SECONDS)
        return asked if said is None else self._sent(said)

    def _sent(self, said: object) -> JointVector:
        """What a driver says that it has sent, where that can be."""
        n = len(self.joint_names)
        try:
            sent = np.array(said, float)
        except (TypeError, ValueError):
            sent = np.empty(0)
        if sent.shape != (n,) or not np.all(np.isfinite(sent)):
            raise DeviceError(
                f"{self.name}: command_velocity() says it sent {said!r}, expected {n} finite "
                "numbers or None"
            )
        return sent

    def stop(self) -> None:
        """Brake and hold.

        Raises:
            DeviceError: the driver's stop() raised or did not return in time.
        """
        self.touched = True
        self._stops += 1
        self._commanded = -np.inf
        self._line.beside("stop()", lambda driver: driver.stop())

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._line.health().with_clock(self._map)

    def close(self) -> None:
        """Stop the arm if it was ever commanded, and let go of it; may be repeated.

        Raises:
            DeviceError: the driver hung or raised.
        """
        try:
            if self.touched and self._line.health().stage != "closed":
                self.stop()
        finally:
            self._line.close()

    # -- in the device's thread -----------------------------------------------------------------

    def _take(self, driver: ArmDriver) -> JointState | None:
        if self._clock.source() > self._commanded + self._settings.watchdog > 0.0:
            self._commanded = -np.inf
            driver.stop()
        reading = driver.read()
        now = self._clock.source()
        if reading is None or (
            self._last is not None and reading.stamp is not None and reading.stamp == self._last[0]
        ):
            return None
        position, velocity = self._vectors(reading)
        effort = None if reading.effort is None else self._vector("effort", reading.effort)
        stamp = self._map.map(reading.stamp, now)
        self._believe(position, stamp)
        status = self._told(reading, stamp)
        self._last = (reading.stamp, position, stamp)
        self._status = status
        return JointState(stamp, position, velocity, effort)

    def _told(self, reading: ArmReading, stamp: float) -> ArmStatus:
        """The controller's word."""
        mode, speed = reading.mode, float(reading.speed)
        if mode not in get_args(ArmMode):
            raise DeviceError(
                f"{self.name}: its mode is {mode!r}, expected one of {', '.join(get_args(ArmMode))}"
            )
        if not 0.0 <= speed < np.inf:
            raise DeviceError(f"{self.name}: its speed is {speed:g}, expected a share, 0 to 1")
        return ArmStatus(stamp, mode, speed, str(reading.message))

    def _vectors(self, reading: ArmReading) -> tuple[JointVector, JointVector]:
        vectors = []
        for what in ("position", "velocity"):
            values = self._vector(what, getattr(reading, what))
            if not np.all(np.isfinite(values)):
                raise DeviceError(f"{self.name}: {what} {values.tolist()} is not finite")
            vectors.append(values)
        return vectors[0], vectors[1]

    def _vector(self, what: str, given: JointVector) -> JointVector:
        values, n = np.array(given, float), len(self.joint_names)
        if values.shape != (n,):
            raise DeviceError(
                f"{self.name}: {what} has shape {values.shape}, expected ({n},): one a joint "
                f"of {', '.join(self.joint_names)}"
            )
        return values

    def _believe(self, position: JointVector, stamp: float) -> None:
        """Refuse joints that cannot be."""
        beyond = np.maximum(self._limits.lower - position, position - self._limits.upper)
        worst = int(np.argmax(beyond))
        if beyond[worst] > BEYOND:
            raise DeviceError(
                f"{self.name}: joint {self.joint_names[worst]} reads {position[worst]:.4g} rad, "
                f"expected {self._limits.lower[worst]:.4g} to {self._limits.upper[worst]:.4g}; "
                "are its joints radians and in the URDF's order?"
            )
        if self._last is None:
            return
        _, before, then = self._last
        moved = np.abs(position - before)
        possible = JUMP[0] + JUMP[1] * self._limits.velocity * max(stamp - then, 0.0)
        worst = int(np.argmax(moved - possible))
        if moved[worst] > possible[worst]:
            raise DeviceError(
                f"{self.name}: joint {self.joint_names[worst]} jumped by {moved[worst]:.3g} rad "
                f"within {1e3 * (stamp - then):.1f} ms, which it cannot"
            )
