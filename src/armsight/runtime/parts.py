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
from armsight.runtime.warm_up import Progress, warm_up

if TYPE_CHECKING:
    from armsight.motion.plan import Planner
    from armsight.runtime.config import SessionConfig
    from armsight.workcell import Cell


@dataclass(frozen=True)
class Parts:
    """What the components wrap.

    Attributes:
        workspace: the map; planner; guard: the pure objects.
        warm_up: compiles and exercises throw-away twins of them; told where to report progress.
    """

    workspace: Maps
    planner: Planner
    guard: Guards
    warm_up: Callable[[Progress], None] = lambda progress: None


MakeParts = Callable[["Cell", "SessionConfig"], Parts]
"""Builds the parts of a session on a cell."""


def make_parts(cell: Cell, config: SessionConfig) -> Parts:
    """The parts for a cell: what ``config`` leaves open comes from the cell's file."""
    infos = cell.guard_cameras
    mapping = config.mapping or mapping_config(cell.workcell, cell.T_world_base, cell.robot.reach)
    guard = config.guard or guard_config(cell.workcell, config)
    speed, acceleration = guard.planned
    planning = PlannerConfig(speed=speed, acceleration=acceleration)

    def make() -> tuple[WorkspaceMap, Planner, Guard]:
        robot = cell.robot
        planner = config.planner or PosePlanner(
            SeparationPlanner(
                RrtConnectPlanner(robot, CollisionModel(robot), planning), robot, infos, guard
            ),
            robot,
            robot.limits.scaled(speed, acceleration),
        )
        return (
            WorkspaceMap(cell.robot, infos, cell.static, mapping),
            planner,
            Guard(cell.robot, infos, guard),
        )

    workspace, planner, made_guard = make()
    return Parts(
        workspace,
        planner,
        made_guard,
        lambda progress: warm_up(cell.robot, infos, make, config.planning_time, progress),
    )
