"""Map, planner and guard of a session, made from a cell's file; and their warm-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armsight.mapping.workspace_map import WorkspaceMap
from armsight.motion.collision import CollisionModel
from armsight.motion.guard import Guard
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.motion.pose_planner import PosePlanner
from armsight.runtime.components import Guards, Maps
from armsight.runtime.configure import guard_config, mapping_config
from armsight.runtime.renewed_map import RenewedMap
from armsight.runtime.warm_up import Progress, warm_up

if TYPE_CHECKING:
    from armsight.devices.data import RgbdCameraInfo
    from armsight.geometry.shapes import Solid
    from armsight.mapping.config import MappingConfig
    from armsight.motion.guard_config import GuardConfig
    from armsight.motion.plan import Planner
    from armsight.robots.robot import Robot
    from armsight.runtime.config import SessionConfig
    from armsight.workcell import Cell


@dataclass(frozen=True)
class Parts:
    """What the components wrap.

    Attributes:
        workspace: the map; planner; guard: the pure objects.
        warm_up: compiles and exercises throw-away twins of them; told where to report progress.
        elsewhere: makes the guard, warmed up, in another process; it and what it holds can be
            pickled. None where that cannot be.
    """

    workspace: Maps
    planner: Planner
    guard: Guards
    warm_up: Callable[[Progress], None] = lambda progress: None
    elsewhere: Callable[[], Guards] | None = None


MakeParts = Callable[["Cell", "SessionConfig"], Parts]
"""Builds the parts of a session on a cell."""


@dataclass(frozen=True)
class Recipe:
    """All that it takes to make the parts of a real session, here or in another process.

    Attributes:
        robot, cameras, static: of the cell.
        mapping, guard: configuration of the parts.
        planning_time: the planner's time limit [s].
    """

    robot: Robot
    cameras: tuple[RgbdCameraInfo, ...]
    static: tuple[Solid, ...]
    mapping: MappingConfig
    guard: GuardConfig
    planning_time: float

    def make(self, planner: Planner | None = None) -> tuple[WorkspaceMap, Planner, Guard]:
        """Fresh parts.

        Args:
            planner: somebody's own.
        """
        guard = Guard(self.robot, self.cameras, self.guard)
        return self.map(), planner or self.planner(), guard

    def map(self) -> WorkspaceMap:
        """A map that has seen nothing."""
        return WorkspaceMap(self.robot, self.cameras, self.static, self.mapping)

    def planner(self) -> Planner:
        """The cell's own."""
        robot, (speed, acceleration) = self.robot, self.guard.planned
        planning = PlannerConfig(speed=speed, acceleration=acceleration)
        paths = RrtConnectPlanner(robot, CollisionModel(robot), planning)
        among_people = SeparationPlanner(paths, robot, self.cameras, self.guard)
        return PosePlanner(among_people, robot, robot.limits.scaled(speed, acceleration))

    def warm_up(self, progress: Progress, planner: Planner | None = None) -> None:
        """Compile and exercise parts that are thrown away."""
        made = lambda: self.make(planner)  # noqa: E731
        warm_up(self.robot, self.cameras, made, self.planning_time, progress)

    def guard_elsewhere(self) -> Guard:
        """A guard in the process of the command path."""
        self.warm_up(lambda stage, done: None)
        return Guard(self.robot, self.cameras, self.guard)


def make_parts(cell: Cell, config: SessionConfig) -> Parts:
    """The parts for a cell: what ``config`` leaves open comes from the cell's file."""
    recipe = Recipe(
        cell.robot,
        tuple(cell.guard_cameras),
        tuple(cell.static),
        config.mapping or mapping_config(cell.workcell, cell.T_world_base, cell.robot.reach),
        config.guard or guard_config(cell.workcell, config),
        config.planning_time,
    )
    return Parts(
        RenewedMap(recipe.map),
        config.planner or recipe.planner(),
        Guard(recipe.robot, recipe.cameras, recipe.guard),
        lambda progress: recipe.warm_up(progress, config.planner),
        recipe.guard_elsewhere,
    )
