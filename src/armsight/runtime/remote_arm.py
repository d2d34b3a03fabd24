"""An arm whose driver runs in the process of the command path."""

from __future__ import annotations

import contextlib
import time

from armsight.arrays import JointVector
from armsight.devices.data import ArmStatus, JointState
from armsight.devices.driven_arm import SILENCE
from armsight.devices.line import NOTICED, DeviceHealth
from armsight.errors import DeviceError, DeviceLostError
from armsight.runtime.command_link import CommandLink
from armsight.runtime.command_messages import State


class RemoteArm:
    """Implements :class:`armsight.devices.protocols.Arm`; the guard beside the driver commands it.

    Args:
        link: to that process.
    """

    def __init__(self, link: CommandLink) -> None:
        self.link = link
        self._newest: State | None = None
        self._silent = 0.0
        self._looked = time.monotonic()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self.link.arm.settings.joint_names

    @property
    def status(self) -> ArmStatus | None:
        """The controller's newest word."""
        return self.link.state.arm

    def read(self) -> JointState | None:
        """The newest reading; None before the first.

        Raises:
            DeviceLostError: the arm is lost, or the process that reads it hangs or is gone.
            DeviceError: it does not answer just now.
        """
        state = self.link.state
        self._watch(state)
        if state.arm_problem:
            kind = DeviceLostError if state.lost else DeviceError
            raise kind(state.arm_problem)
        return state.joints

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Nobody but the guard beside the driver commands it.

        Raises:
            DeviceError: always.
        """
        raise DeviceError(f"arm {self.link.arm.settings.name}: its guard's process commands it")

    def stop(self) -> None:
        """Brake and hold.

        Raises:
            DeviceError: it cannot be told.
        """
        self.link.halt()

    def health(self) -> DeviceHealth:
        """How it is."""
        name = f"arm {self.link.arm.settings.name}"
        with contextlib.suppress(DeviceError):
            return self.link.state.device or DeviceHealth(name, "opening")
        return DeviceHealth(name, "lost", "the process of its command path is gone")

    def close(self) -> None:
        """Let go of it, stopped if it was ever commanded; may be repeated."""
        self.link.close()

    def _watch(self, word: State) -> None:
        """Give a process up that says nothing; one that stands still with us is not held to it."""
        now = time.monotonic()
        passed, self._looked = min(now - self._looked, NOTICED), now
        self._silent = self._silent + passed if word is self._newest else 0.0
        self._newest = word
        if self._silent > SILENCE:
            self.link.give_up(
                f"arm {self.link.arm.settings.name}: the process of its command path has said "
                f"nothing for {SILENCE:g} s"
            )
