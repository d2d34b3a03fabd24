"""The guarded cell before a flat target: its map from the truth, and contact that pushes.

What :class:`.QuickCell` is to the guard, with the target's surface as points in the map; where the
target gives way, the arm, its drives, the force sensor and contact are the simulated world's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, JointVector, Points, Pose, Vector3
from armsight.experiments.quick_cell import VOXEL, QuickCell
from armsight.experiments.servo_eyes import Path
from armsight.experiments.servo_world import Setup, mapped_box
from armsight.geometry.pose import inverse
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.robots.kinematics import sphere_centers, tcp_pose
from armsight.simulation.spec import ArmSpec, MovingObjectSpec, WorldSpec, WrenchSpec
from armsight.simulation.truth import Contact
from armsight.simulation.world import SimulatedWorld

OWN = 0.03
"""What is so close to the arm the self-filter takes for the arm: its margin, the cameras' noise and
half a voxel [m]. Where the tip touches, the map shows nothing."""


class SurfaceCell(QuickCell):
    """Guard and kinematic arm before a surface that moves without turning.

    Args:
        setup: the cell.
        surface: (k, 3) points on it, less where the target is [m], axes of ``base``.
        path: (3,) the target's place in ``base`` at a time [m].
        start: (n,) joints [rad]; seed: of the planner.
    """

    begins = 0.0

    def __init__(
        self, setup: Setup, surface: Points, path: Path, start: JointVector, seed: int = 0
    ) -> None:
        box = mapped_box(setup)
        super().__init__([], robot=setup.robot, config=setup.guard, seed=seed, rate=60.0, box=box)
        self.surface, self.path = surface, path
        self.q = np.array(start, float)

    def place(self, time: float) -> Vector3:
        """(3,) where the target is at a time [s]."""
        return self.path(time)

    def tip(self) -> Vector3:
        """(3,) where the tip is, in ``base``, the arm being as it is believed to be [m]."""
        return np.asarray(tcp_pose(self.robot, self.q)[:3, 3])

    def snapshot_at(self, stamp: float) -> WorkspaceSnapshot:
        """What a perfect map says of the surface, less what is too close to the arm."""
        empty = super().snapshot_at(stamp)
        index = self.grid.index(self.surface + self.place(stamp))
        index = index[((index >= 0) & (index < self.grid.shape)).all(axis=1)]
        flat = np.unique(np.ravel_multi_index(tuple(index.T), self.grid.shape))
        points = self.grid.center(np.stack(np.unravel_index(flat, self.grid.shape), axis=1))
        arm, reach = sphere_centers(self.robot, self.q), self.robot.spheres.radius + OWN
        low, high = (arm - reach[:, None]).min(axis=0), (arm + reach[:, None]).max(axis=0)
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        away = np.linalg.norm(points[near, None] - arm[None], axis=2) - reach
        seen = np.ones(len(points), bool)
        seen[near] = away.min(axis=1, initial=np.inf) > 0.0
        hazards = np.asarray(points[seen], np.float32)
        return replace(
            empty, hazards=hazards, hazard_unknown=np.zeros(len(hazards), bool), cloud=hazards
        )


class PushedCell(SurfaceCell):
    """The same with the simulated world's arm, force sensor and contact.

    Args:
        setup, surface, path, start, seed: as above.
        item: the target, giving way; its place is led along the path.
        T_item_target: where the target's point is in the item's frame.
    """

    def __init__(
        self,
        setup: Setup,
        surface: Points,
        path: Path,
        start: JointVector,
        item: MovingObjectSpec,
        T_item_target: Pose,
        seed: int = 0,
    ) -> None:
        super().__init__(setup, surface, path, start, seed)
        base = setup.workcell.robot.T_world_base
        arm = ArmSpec(
            setup.robot, base, self.q.copy(), self.config.start_delay,
            speed=setup.workcell.robot.speed, acceleration=setup.workcell.robot.acceleration,
            kinematic_error=0.0,
        )  # fmt: skip
        spec = WorldSpec(
            arm, objects=(item,), time_step=0.001, floor=False,
            wrench=WrenchSpec(500.0, low_pass=100.0), pushes=True,
        )  # fmt: skip
        self.world = SimulatedWorld(spec, seed)
        self._name, self._base, self._T = item.solid.name, base, T_item_target

    @property
    def contacts(self) -> list[Contact]:
        """What the arm really touched."""
        return self.world.truth.contacts

    def place(self, time: float) -> Vector3:
        """(3,) where the target is now, in ``base``: it may have been pushed away [m]."""
        if not hasattr(self, "world"):
            return self.path(time)
        T = inverse(self._base) @ self.world._pose(self._name) @ self._T
        return np.asarray(T[:3, 3])

    def drive(self, until: float) -> None:
        """Let the world go on to a time [s]."""
        sent = self.commands[-1]
        if sent[-1]:
            self.world.arm.stop()
        else:
            self.world.arm.command_velocity(sent[:-1])
        place = self._base[:3, :3] @ self.path(until) + self._base[:3, 3]
        self.world.drag(self._name, self._offset(place))
        self.world.advance(until)
        state = self.world.arm.read()
        if state is not None:
            self.q, self.v = state.position, state.velocity
        self.now = until
        if self.world.wrench is not None:
            self.guard.feel(list(iter(self.world.wrench.read, None)))

    def close(self) -> None:
        """End the world."""
        self.world.close()

    def _offset(self, place: Vector3) -> Vector3:
        """Where (3,) the item's own frame is in world when its target is at a place there."""
        R = self.world._pose(self._name)[:3, :3]
        return np.asarray(place - R @ self._T[:3, 3])


def plate(size: tuple[float, float], thick: float, R: Floats, middle: Vector3) -> Points:
    """(k, 3) points of a box's surface every half voxel, about a middle, turned by R (3, 3) [m]."""
    axes = [
        np.linspace(-0.5 * s, 0.5 * s, max(round(2 * s / VOXEL), 1) + 1) for s in (*size, thick)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    half = 0.5 * np.array([*size, thick])
    skin = (np.abs(np.abs(grid) - half) < 1e-9).any(axis=1)
    return np.asarray(grid[skin] @ R.T + middle)
