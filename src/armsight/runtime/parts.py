"""Map, planner and guard of a session, made from a cell; and their warm-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armsight.runtime.components import Guards, Maps

if TYPE_CHECKING:
    from armsight.motion.plan import Planner
    from armsight.runtime.config import SessionConfig
    from armsight.workcell import Cell

Progress = Callable[[str, float], None]


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


def make_parts(cell: Cell, config: SessionConfig) -> Parts:
    """The parts for a cell."""
    from armsight.mapping.config import MappingConfig
    from armsight.mapping.workspace_map import WorkspaceMap
    from armsight.motion.guard import Guard, GuardConfig
    from armsight.motion.planner import default_planner
    from armsight.runtime.warm_up import warm_up

    infos = [camera.info for camera in cell.cameras]
    mapping = config.mapping or MappingConfig()
    guard = config.guard or GuardConfig()
    planner = config.planner or default_planner(cell.robot)

    def make() -> tuple[WorkspaceMap, Planner, Guard]:
        return (
            WorkspaceMap(cell.robot, infos, cell.static, mapping),
            planner,
            Guard(cell.robot, infos, cell.static, guard),
        )

    workspace, planner, made_guard = make()
    return Parts(workspace, planner, made_guard, lambda progress: warm_up(cell, make, progress))
