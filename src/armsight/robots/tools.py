"""What a flange can carry: tools with their shapes, looks and mass."""

from __future__ import annotations

import difflib
from functools import cache

import numpy as np

from armsight.errors import RobotError
from armsight.geometry.pose import make_pose
from armsight.robots.robot import Tool
from armsight.robots.shapes import make_capsules, make_spheres

TOOL_NAMES: tuple[str, ...] = (
    "gripper",
    "panda_hand",
    "pen",
    "calibration_board",
    "type2_plug",
)
"""The tools that :func:`load_tool` knows."""

_LENGTH = {
    "gripper": 0.16,
    "panda_hand": 0.11,
    "pen": 0.15,
    "calibration_board": 0.06,
    "type2_plug": 0.18,
}


@cache
def load_tool(name: str) -> Tool:
    """A tool of the catalogue.

    Raises:
        RobotError: there is no such tool; names the known ones.
    """
    if name not in TOOL_NAMES:
        near = difflib.get_close_matches(str(name).lower(), TOOL_NAMES, n=1, cutoff=0.5)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise RobotError(f'unknown tool "{name}"; known: {", ".join(TOOL_NAMES)}{hint}')
    length, radius = _LENGTH[name], 0.05
    rows = [(0, [0.0, 0.0, float(z), radius]) for z in np.linspace(0.0, length - radius, 3)]
    capsule = [(0, [0.0, 0.0, 0.0, 0.0, 0.0, length - radius, radius])]
    return Tool(
        name,
        make_pose(None, [0.0, 0.0, length]),
        make_spheres(rows),
        make_capsules(capsule),
        (),
        0.5,
        np.array([0.0, 0.0, 0.5 * length]),
    )
