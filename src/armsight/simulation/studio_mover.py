"""Moves a simulated arm from rest to rest, and photographs with a studio: no guard, no people.

For calibration in simulation, where only declared solids are there. In a running cell the guard
moves the arm.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointVector
from armsight.simulation.board import BoardStudio, Photograph
from armsight.simulation.world import SimulatedWorld

TICK = 0.008
"""Seconds between commands [s]."""


class StudioMover:
    """Straight joint moves by trapezoids of speed, and pictures at rest."""

    def __init__(self, world: SimulatedWorld, studio: BoardStudio) -> None:
        self._world = world
        self._studio = studio
        spec = world.spec.arm
        self._speed = spec.robot.limits.velocity * spec.speed
        self._acceleration = spec.robot.limits.acceleration * spec.acceleration
        if world.arm.read() is None:
            world.advance(world.clock.now() + 0.05)

    def now(self) -> float:
        """The cell's time [s]."""
        return float(self._world.clock.now())

    def joints(self) -> JointVector:
        """(n,) where the arm says it is [rad]."""
        state = self._world.arm.read()
        assert state is not None
        return np.asarray(state.position)

    def move(self, joints: JointVector) -> bool:
        """Bring the arm to rest at joint angles; False if it does not arrive."""
        world = self._world
        start = self.joints()
        way = np.asarray(joints, float) - start
        far = np.abs(way)
        if far.max() < 1e-5:
            return True
        # One profile s(t) of 0..1 for all joints, within each one's limits.
        v = float(np.min(self._speed / np.maximum(far, 1e-9)))
        a = 0.9 * float(np.min(self._acceleration / np.maximum(far, 1e-9)))
        v = min(v * 0.97, np.sqrt(a))
        ramp = v / a
        total = 1 / v + ramp
        began = world.clock.now()
        deadline = began + total + 2.0
        delay = world.spec.arm.start_delay
        while world.clock.now() < deadline:
            t = world.clock.now() - began
            s, ds = _profile(t, v, a, ramp, total)
            behind, _ = _profile(t - delay - 0.01, v, a, ramp, total)
            error = start + behind * way - self.joints()
            world.arm.command_velocity(ds * way + 4.0 * error)
            world.advance(world.clock.now() + TICK)
            if t > total + delay:
                state = world.arm.read()
                assert state is not None
                close = np.abs(state.position - joints).max() < 3e-4
                if close and np.abs(state.velocity).max() < 5e-3:
                    break
            del s
        world.arm.stop()
        world.advance(world.clock.now() + delay + 0.02)
        return bool(np.abs(self.joints() - joints).max() < 5e-3)

    def look(self, cameras: tuple[int, ...], rest: float, frames: int) -> list[Photograph]:
        """Rest, wait for the exposures of all cameras, and take the pictures."""
        world = self._world
        rate = min(self._studio.cameras[c].rate for c in cameras)
        world.advance(world.clock.now() + rest + frames / rate)
        return [self._studio.photograph(c, frames) for c in cameras]


def _profile(t: float, v: float, a: float, ramp: float, total: float) -> tuple[float, float]:
    """Share of the way and its rate at time t of a trapezoid."""
    if t <= 0:
        return 0.0, 0.0
    if t >= total:
        return 1.0, 0.0
    if t < ramp:
        return 0.5 * a * t * t, a * t
    if t > total - ramp:
        left = total - t
        return 1 - 0.5 * a * left * left, a * left
    return 0.5 * a * ramp * ramp + v * (t - ramp), v
