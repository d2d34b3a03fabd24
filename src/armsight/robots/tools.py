"""What a flange can carry: tools with their shapes, looks and mass.

``data/tools/NAME/tool.json`` and the OBJ files beside it are made by ``scripts/make_tools.py``, all
in the flange's frame: z outward along the tool's axis.
"""

from __future__ import annotations

import difflib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from armsight.errors import RobotError
from armsight.robots.robot import LinkMesh, Tool
from armsight.robots.shapes import FitReport, make_capsules, make_spheres

TOOLS_DATA = Path(__file__).parent / "data" / "tools"
BOARD_TOOL = "calibration_board"
"""The tool whose place on the flange is the calibration board's."""
SPHERE_TOOL = "sphere_marker"
"""The tool whose tip is the middle of a ball of 150 mm, the marker of ``calibrate --sphere``."""
TOOL_NAMES: tuple[str, ...] = (
    "gripper",
    "panda_hand",
    "pen",
    SPHERE_TOOL,
    "straw_cup",
    BOARD_TOOL,
    "type1_plug",
    "type2_plug",
    "ccs2_plug",
)
"""The tools that :func:`load_tool` knows."""


@dataclass(frozen=True)
class ToolSheet:
    """What a tool is, where it comes from, and how well its shapes fit its meshes."""

    title: str
    license: str
    origin: str
    sphere_fit: FitReport
    capsule_fit: FitReport


def load_tool(name: str) -> Tool:
    """A tool of the catalogue, or one's own. The same object every time; it is immutable.

    Args:
        name: of the catalogue, or the path of a folder with ``tool.toml``: whatever has a slash.

    Raises:
        RobotError: there is no such tool (names the known ones), or its files are broken.
    """
    if is_path(name):
        from armsight.robots.own_tool import own_tool

        return _loaded(own_tool(Path(name)))
    _check_known(name)
    return _loaded(TOOLS_DATA / name)


def is_path(name: str) -> bool:
    """Whether a tool's name means a folder, not a tool of the catalogue."""
    return "/" in name or "\\" in name


@cache
def _loaded(folder: Path) -> Tool:
    return load_tool_folder(folder)


def tool_sheet(name: str) -> ToolSheet:
    """Title, source and fit of a tool of the catalogue.

    Raises:
        RobotError: there is no such tool.
    """
    _check_known(name)
    return folder_sheet(TOOLS_DATA / name)


def folder_sheet(folder: Path) -> ToolSheet:
    """What stands in a tool's folder about it.

    Raises:
        RobotError: its ``tool.json`` is missing or broken.
    """
    data = _read(folder / "tool.json")
    fit = {f"{key[:-1]}_fit": FitReport(**value) for key, value in data["fit"].items()}
    return ToolSheet(data["title"], data["license"], data["origin"], **fit)


def load_tool_folder(folder: Path) -> Tool:
    """A tool from a folder with ``tool.json`` and its meshes.

    Raises:
        RobotError: a file is missing or broken.
    """
    path = folder / "tool.json"
    data = _read(path)
    try:
        meshes = tuple(
            LinkMesh(0, folder / mesh["file"], (mesh["color"][0], *mesh["color"][1:3]))
            for mesh in data["meshes"]
        )
        tool = Tool(
            name=folder.name,
            T_flange_tcp=np.array(data["T_flange_tcp"], float).reshape(4, 4),
            spheres=make_spheres([(0, row) for row in data["spheres"]]),
            capsules=make_capsules([(0, row) for row in data["capsules"]]),
            meshes=meshes,
            mass=float(data["mass"]),
            center_of_mass=np.array(data["center_of_mass"], float).reshape(3),
        )
    except KeyError as error:
        raise RobotError(f"{path}: {error} is missing") from None
    except (TypeError, ValueError, IndexError) as error:
        raise RobotError(f"{path}: is broken ({error}); restore it") from None
    for mesh in tool.meshes:
        if not mesh.path.is_file():
            raise RobotError(f"{path}: mesh {mesh.path} is missing; put it there")
    return tool


def _read(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise RobotError(f"{path}: is not JSON ({error}); restore it") from None
    if not isinstance(data, dict):
        raise RobotError(f"{path}: is broken (no object); restore it")
    return data


def _check_known(name: str) -> None:
    if name in TOOL_NAMES:
        return
    near = difflib.get_close_matches(str(name).lower(), TOOL_NAMES, n=1, cutoff=0.5)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    raise RobotError(
        f'unknown tool "{name}"; known: {", ".join(TOOL_NAMES)}{hint}; one of your own is the path '
        "of a folder, such as ./my_gripper"
    )
