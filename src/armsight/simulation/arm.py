"""The simulated arm: drives with limits, delay and watchdog; readings with latency and noise."""

from __future__ import annotations

from collections import deque

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.devices.data import ArmMode, ArmStatus, JointState
from armsight.errors import DeviceError
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.kernels import drive_step
from armsight.simulation.spec import ArmSpec

ENCODER_NOISE = 5e-6
"""Standard deviation of a joint reading [rad]: about a 19-bit encoder."""
VELOCITY_NOISE = 5e-4
"""Standard deviation of a velocity reading [rad/s]."""
HISTORY = 4096
"""Readings kept; more than any latency needs."""
SLIP = 0.02
"""The reference never runs further ahead of a blocked joint than this [rad]."""

_BRAKE = None


class SimulatedArm:
    """Implements :class:`armsight.devices.protocols.Arm`.

    A command takes ``start_delay`` to reach the drives, a stop as well. The drives ramp towards it
    within the controller's share of acceleration; a stop and the watchdog brake with all that the
    drives have (``limits.acceleration``).
    """

    def __init__(
        self,
        spec: ArmSpec,
        clock: SimulatedClock,
        time_step: float,
        seed: int,
        compliance: float = 0.0,
    ) -> None:
        """Prepare the arm.

        Args:
            spec: which arm and how it is driven.
            clock: of the cell.
            time_step: of the physics [s].
            seed: of its noise.
            compliance: twist of a joint under the load it carries [rad/(N m)].
        """
        limits = spec.robot.limits
        self._spec = spec
        self._clock = clock
        self._dt = time_step
        self._seed = seed
        self._lower, self._upper = limits.lower.astype(float), limits.upper.astype(float)
        self._speed = limits.velocity * spec.speed
        self._acceleration = limits.acceleration * spec.acceleration
        self._brake = limits.acceleration.astype(float)
        self.compliance = compliance
        # The tip's error follows the joints' with levers of about a reach in all.
        self._rest_sigma = spec.repeatability / (1.1 * spec.robot.reach)
        self._every = max(1, round(1.0 / (spec.state_rate * time_step)))
        self.reset()

    def reset(self) -> None:
        """Back to the start: at rest in the home configuration, nothing commanded."""
        n = self._spec.robot.n
        home = np.asarray(self._spec.home, float)
        self._queue: deque[tuple[float, JointVector | None]] = deque()
        self._target = np.zeros(n)
        self._braking = True
        self._heard = -np.inf
        self._failed = ""
        self._mode: ArmMode = "running"
        self.reference_position = home.copy()
        self.reference_velocity = np.zeros(n)
        self._readings = np.zeros((HISTORY, 3, n))
        self._stamps = np.full(HISTORY, -np.inf)
        self._count = 0
        self._rng = np.random.default_rng((self._seed, 1))
        self._noise = np.random.default_rng((self._seed, 2)).standard_normal((HISTORY, 2, n))
        self._rest_offset = self._rng.standard_normal(n) * self._rest_sigma
        self._rest_next = self._rest_offset
        self._resting = True

    # What the rest of armsight sees -----------------------------------------------------------

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the URDF's order."""
        return self._spec.robot.joint_names

    @property
    def status(self) -> ArmStatus:
        """The controller's word on itself."""
        return ArmStatus(self._clock.now(), self._mode)

    def read(self) -> JointState | None:
        """The newest reading that has arrived, or None before the first."""
        self._check()
        newest = self._clock.now() - self._spec.state_latency + 1e-9
        for back in range(1, min(self._count, HISTORY) + 1):
            slot = (self._count - back) % HISTORY
            if self._stamps[slot] <= newest:
                q, qd, effort = self._readings[slot]
                return JointState(
                    float(self._stamps[slot]),
                    q + ENCODER_NOISE * self._noise[slot, 0],
                    qd + VELOCITY_NOISE * self._noise[slot, 1],
                    effort.copy(),
                )
        return None

    def command_velocity(self, velocity: JointVector) -> JointVector:
        """Ask for (n,) velocities [rad/s]; returns them as sent, slowed as one to keep direction.

        Raises:
            DeviceError: the arm is lost, or the command is not n finite numbers.
        """
        self._check()
        if self._mode != "running":
            raise DeviceError(f"arm {self._spec.robot.name}: refuses commands ({self.status})")
        wanted = np.asarray(velocity, float)
        if wanted.shape != self._target.shape or not np.all(np.isfinite(wanted)):
            raise DeviceError(
                f"arm {self._spec.robot.name}: a velocity command is {len(self._target)} finite "
                f"numbers in rad/s, not {velocity!r}"
            )
        excess = float(np.max(np.abs(wanted) / self._speed, initial=0.0))
        sent = wanted / excess if excess > 1.0 else wanted.copy()
        self._queue.append((self._clock.now() + self._spec.start_delay, sent))
        return sent.copy()

    def stop(self) -> None:
        """Brake as fast as the drives allow and hold."""
        self._queue.append((self._clock.now() + self._spec.start_delay, _BRAKE))

    # What the world does with it ---------------------------------------------------------------

    def fail(self, problem: str = "connection lost") -> None:
        """Break the connection, for tests: reads and commands raise, the watchdog stops the arm."""
        self._failed = problem

    def protective_stop(self, stopped: bool = True) -> None:
        """Let the arm's own controller stop it, for tests: it brakes and refuses commands."""
        self._mode = "protective_stop" if stopped else "running"
        if stopped:
            self.stop()

    def mend(self) -> None:
        """Undo :meth:`fail`."""
        self._failed = ""

    def before_step(self, now: float, position: JointVector, control: Floats) -> None:
        """Move the drives' reference on by one step from ``now`` [s] and write the servos' input.

        Args:
            now: time at the start of the step [s].
            position: (n,) true joint positions [rad].
            control: (2 n,) servo inputs, written: positions, then velocities.
        """
        queue = self._queue
        while queue and queue[0][0] <= now + 1e-9:
            arrived, command = queue.popleft()
            self._braking = command is _BRAKE
            self._target = np.zeros_like(self._target) if command is None else command
            self._heard = arrived
        if now - self._heard > self._spec.watchdog + 1e-9:
            self._braking = True
        n = len(self.reference_position)
        control[:n] = self.reference_position  # where the joints should be now, before the step
        drive_step(
            self._target,
            self._braking,
            self.reference_position,
            self.reference_velocity,
            self._lower,
            self._upper,
            self._acceleration,
            self._brake,
            self._dt,
        )
        np.clip(
            self.reference_position,
            position - SLIP,
            position + SLIP,
            out=self.reference_position,
        )
        control[n:] = self.reference_velocity

    def sense(
        self, step: int, now: float, position: Floats, velocity: Floats, drive: Floats, load: Floats
    ) -> None:
        """Remember the joints after a physics step, at the state rate.

        Args:
            step: number of the step.
            now: its end [s].
            position: (n,) true joints [rad].
            velocity: (n,) true speeds [rad/s].
            drive: (n,) torque of the servos [N m].
            load: (n,) torque that holds the weight [N m].
        """
        if step % self._every:
            return
        slot = self._count % HISTORY
        reading = self._readings[slot]
        reading[0] = position + self._rest_offset + self.compliance * load
        reading[1] = velocity
        reading[2] = drive + load
        self._stamps[slot] = now
        self._count += 1
        self._settle()

    def _settle(self) -> None:
        """After every rest the arm stops a little elsewhere; the change happens on the way."""
        resting = not self.reference_velocity.any()
        if resting:
            self._resting = True
            return
        if self._resting:
            self._resting = False
            n = len(self._rest_offset)
            self._rest_next = self._rng.standard_normal(n) * self._rest_sigma
        self._rest_offset = self._rest_offset + 0.01 * (self._rest_next - self._rest_offset)

    def _check(self) -> None:
        if self._failed:
            raise DeviceError(f"arm {self._spec.robot.name}: {self._failed}")
