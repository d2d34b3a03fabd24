"""A cell in which the arm may touch: real contact, and a map made from the truth, as late as any.

The guard sees what :class:`.QuickCell` shows it; the arm, its drives, the force sensor and whatever
is touched are those of the simulated world, in steps of a millisecond. No picture is rendered.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Vector3
from armsight.devices.data import Wrench
from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import Intent, VelocityIntent
from armsight.motion.permits import ContactKind, PermitRequest
from armsight.motion.regions import Region
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.simulation.spec import ArmSpec, MovingObjectSpec, WorldSpec, WrenchSpec
from armsight.simulation.truth import Contact
from armsight.simulation.world import SimulatedWorld

TARGET = "target"
SEEN_AFTER = 0.09
"""Exposure to the task's round, of what the task sees of its target [s]."""
SEEN_EVERY = 1.0 / 30.0
"""Time between two looks at the target [s]."""
GLOVE = 0.02
"""Where the target of a permit for a person begins inside its region [m]."""

Path = Callable[[float], Vector3]
"""Where something is in ``base`` at a time [s]."""


def pointing_arm() -> Robot:
    """A UR5 with a pen."""
    return load_robot("ur5").with_tool(load_tool("pen"))


@dataclass(frozen=True)
class Target:
    """What is to be touched.

    Attributes:
        path: of its centre; radius: [m].
        mass: [kg]; surface, hold: stiffness of its surface and of what holds it [N/m].
    """

    path: Path
    radius: float
    mass: float
    surface: float
    hold: float


class TouchCell(QuickCell):
    """Guard and simulated arm beside one target that gives way, and others that do not.

    Args:
        target: what is to be touched.
        others: who else is there, seen by the guard alone.
        robot: with its tool; config: of the guard.
        seed: of the world's errors and of the planner.

    Attributes:
        world: the simulation; silent: readings of the force sensor are lost from then on [s].
        frozen: from then on [s] it says the same again and again, with fresh stamps.
        shown: where the map has the target; the truth's own place.
    """

    def __init__(
        self,
        target: Target,
        others: Sequence[Ball] = (),
        *,
        robot: Robot | None = None,
        config: GuardConfig | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(
            [Ball(self._place, target.radius), *others],
            robot=robot or pointing_arm(),
            config=config,
            seed=seed,
        )
        solid = Solid(TARGET, "sphere", (target.radius, 0, 0), make_pose(None, target.path(0.0)))
        item = MovingObjectSpec(
            solid,
            mass=target.mass,
            surface=target.surface,
            hold=target.hold,
            max_speed=10.0,
        )
        arm = ArmSpec(self.robot, np.eye(4), self.q.copy(), self.config.start_delay)
        spec = WorldSpec(
            arm,
            objects=(item,),
            time_step=0.001,
            floor=False,
            wrench=WrenchSpec(500.0, low_pass=100.0),
            pushes=True,
        )
        self.world = SimulatedWorld(spec, seed)
        self.silent = self.frozen = np.inf
        self.lie = 0.0
        self._last: Wrench | None = None
        self._path = target.path

    @property
    def contacts(self) -> list[Contact]:
        """What the arm really touched."""
        return self.world.truth.contacts

    def declare_firm(self, place: Vector3, way: Vector3) -> None:
        """Something firm and declared, 40 cm wide and 10 cm thick, begins at a (3,) place [m].

        Args:
            place: of its middle [m].
            way: (3,) unit vector into it.
        """
        voxels = np.indices(self.grid.shape).reshape(3, -1).T
        p = self.grid.center(voxels) - place
        depth = p @ way
        across = np.linalg.norm(p - depth[:, None] * way, axis=1)
        self.state.reshape(-1)[(depth > 0.01) & (depth < 0.1) & (across < 0.2)] = OCCUPIED

    def drive(self, until: float) -> None:
        """Let the world go on to a time [s]."""
        sent = self.commands[-1]
        if sent[-1]:
            self.world.arm.stop()
        else:
            self.world.arm.command_velocity(sent[:-1])
        self.world.drag(TARGET, self._path(until))
        self.world.advance(until)
        state = self.world.arm.read()
        if state is not None:
            self.q, self.v = state.position, state.velocity
        self.now = until
        if self.world.wrench is not None:
            felt = [self._felt(w) for w in iter(self.world.wrench.read, None)]
            if until < self.silent:
                self.guard.feel(felt)
        if len(self.balls) > 1:
            self._look()

    def close(self) -> None:
        """End the world."""
        self.world.close()

    def _felt(self, reading: Wrench) -> Wrench:
        if reading.stamp < self.frozen or self._last is None:
            self._last = Wrench(reading.stamp, reading.force + self.lie, reading.torque)
        return replace(self._last, stamp=reading.stamp)

    def _place(self, t: float) -> Vector3:
        """Where the target is seen at about a time [s]; it may have been pushed away."""
        if not hasattr(self, "world"):
            return np.array([9.0, 0.0, 0.0])
        return np.asarray(self.world._pose(TARGET)[:3, 3])


class Toucher:
    """A task: to the target, until it is felt, a second of holding, and back.

    Args:
        cell: in which.
        kind: of the permit; radius: of the region [m].
        noise: standard deviation of the place that is seen [m].
        limits: of the request: speed, force, torque.
        felt: as much is contact enough [N].
    """

    def __init__(
        self,
        cell: TouchCell,
        kind: ContactKind,
        radius: float,
        rng: np.random.Generator,
        *,
        noise: float = 0.002,
        limits: tuple[float, float, float] = (0.05, 10.0, 2.0),
        felt: float = 2.0,
    ) -> None:
        self.cell, self.kind, self.radius, self.noise = cell, kind, radius, noise
        self.limits, self.felt = limits, felt
        self.lost = self.jump = np.inf
        self.touched = np.inf
        self.done = False
        self._rng = rng
        self._seen: tuple[float, Vector3] = (-np.inf, np.zeros(3))
        self._velocity = np.zeros(3)
        self._before: tuple[float, Vector3] = self._seen
        self._places: list[tuple[float, Vector3]] = []

    def __call__(self) -> Intent | None:
        """What is wanted in this tick."""
        cell, now = self.cell, self.cell.now
        self._look(now)
        stamp, place = self._seen
        if not np.isfinite(stamp):
            return None
        last = cell.log[-1].permit if cell.log else None
        if last is not None and last.pressed > self.felt:
            self.touched = min(self.touched, now)
        tip = tcp_pose(cell.robot, cell.q)[:3, 3]
        way = place + (now - stamp) * self._velocity - tip
        away = max(float(np.linalg.norm(way)), 1e-9)
        leave = now > self.touched + 1.0
        speed = min(0.4, 2.0 * away) if not np.isfinite(self.touched) else 0.0
        velocity = np.zeros(6)
        velocity[:3] = self._velocity + way / away * (-0.05 if leave else speed)
        self.done = leave and away > self.radius + 0.1
        region = Region(
            "sphere",
            (self.radius, 0.0, 0.0),
            make_pose(None, place),
            stamp,
            self._velocity,
            self.noise**2 * np.eye(3),
            0.02 if self.kind == "thing" else 0.1,
        )
        permit = PermitRequest(
            "target",
            self.kind,
            region,
            ("tool",),
            0.12,
            *self.limits,
            seconds=30.0,
        )
        return VelocityIntent("touch", velocity, "base", stamp, now + 0.1, permit)

    def _look(self, now: float) -> None:
        """Take in what was exposed a while ago, at the rate of pictures."""
        self._places.append((now, self.cell._place(now)))
        if now > self.lost or now - self._seen[0] < SEEN_AFTER + SEEN_EVERY:
            return
        old = [p for p in self._places if p[0] <= now - SEEN_AFTER]
        if not old:
            return
        self._places = self._places[len(old) - 1 :]
        stamp, place = old[-1]
        place = place + self._rng.normal(size=3) * self.noise
        if now > self.jump:
            place = place + np.array([0.0, 0.15, 0.0])
        if np.isfinite(self._seen[0]):
            rate = (place - self._seen[1]) / max(stamp - self._seen[0], 1e-3)
            self._velocity = 0.92 * self._velocity + 0.08 * rate
        self._seen = (stamp, place)
