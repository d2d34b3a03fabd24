"""The schema of workcell.toml, its checks, and building devices from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armsight.workcell.beliefs import camera_info_of, robot_in
    from armsight.workcell.build import Cell, open_cell, simulated_world
    from armsight.workcell.load import load_workcell, parse_workcell
    from armsight.workcell.schema import Workcell
    from armsight.workcell.simulated import world_spec

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
    "camera_info_of": "beliefs",
    "load_workcell": "load",
    "open_cell": "build",
    "parse_workcell": "load",
    "robot_in": "beliefs",
    "simulated_world": "build",
    "world_spec": "simulated",
}


def __getattr__(name: str) -> Any:
    # Lazily: reading a file must not load the physics, nor `armsight --help` either of them.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
