"""The schema of workcell.toml, its checks, and building devices from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armsight.workcell.build import (
        Cell,
        camera_info_of,
        open_cell,
        robot_in,
        simulated_world,
        world_spec,
    )
    from armsight.workcell.load import load_workcell, parse_workcell
    from armsight.workcell.schema import Workcell

__all__ = [
    "Cell",
    "Workcell",
    "camera_info_of",
    "load_workcell",
    "open_cell",
    "parse_workcell",
    "robot_in",
    "simulated_world",
    "world_spec",
]

_HOME = {
    "Cell": "build",
    "Workcell": "schema",
    "camera_info_of": "build",
    "load_workcell": "load",
    "open_cell": "build",
    "parse_workcell": "load",
    "robot_in": "build",
    "simulated_world": "build",
    "world_spec": "build",
}


def __getattr__(name: str) -> Any:
    # Lazily: reading a file must not load the physics, nor `armsight --help` either of them.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
