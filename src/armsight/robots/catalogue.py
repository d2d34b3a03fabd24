"""The catalogue of arms: one folder of ``data/`` each, with URDF, meshes, shapes and data sheet."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from armsight.errors import RobotError
from armsight.robots import tools
from armsight.robots.folder import load_arm, mark_of
from armsight.robots.robot import Robot
from armsight.robots.shapes import BodyShapes, read_shapes
from armsight.robots.sheet import read_toml

DATA = Path(__file__).parent / "data"
ROBOT_NAMES: tuple[str, ...] = (
    "ur3",
    "ur5",
    "ur10",
    "ur3e",
    "ur5e",
    "ur10e",
    "ur16e",
    "iiwa",
    "iiwa14",
    "panda",
    "fr3",
)
"""The arms that :func:`load_robot` knows."""


@dataclass(frozen=True)
class RobotSheet:
    """What the maker says of an arm, and where its files come from.

    Attributes:
        title: the arm's full name.
        flange: the URDF link that is the flange.
        reach: [m]; payload: [kg]; repeatability: [m].
        license: SPDX name; origin, package: where the files were taken from; changes: what was
            done to them.
    """

    title: str
    flange: str
    reach: float
    payload: float
    repeatability: float
    license: str
    origin: str
    package: str
    changes: str


def load_robot(model: str) -> Robot:
    """An arm without a tool: of the catalogue, or a user's own from a folder or a URDF.

    The same object every time while its files stay the same; it is immutable.

    Args:
        model: a name of the catalogue, or a path: whatever has a slash in it or ends in ``.urdf``.

    Raises:
        RobotError: there is no such arm (names the known ones), or its files are broken.
    """
    if is_path(model):
        path = Path(model)
        return _own(path, mark_of(path))
    _check_known(model)
    return _known(model)


def is_path(model: str) -> bool:
    """Whether a robot's model means a folder or a URDF, not a name of the catalogue."""
    return tools.is_path(model) or model.lower().endswith(".urdf")


@cache
def _known(name: str) -> Robot:
    return load_arm(DATA / name)


@lru_cache(maxsize=8)
def _own(path: Path, mark: str) -> Robot:
    return load_arm(path)


def robot_sheet(name: str) -> RobotSheet:
    """Data sheet and source of an arm of the catalogue.

    Raises:
        RobotError: there is no such arm.
    """
    _check_known(name)
    data = read_toml(DATA / name / "robot.toml")
    return RobotSheet(**{k: data[k] for k in _SHEET_KEYS}, **data["source"])


def robot_shapes(name: str) -> BodyShapes:
    """Shapes of an arm of the catalogue with the record of their fit."""
    return read_shapes(DATA / name / "shapes.json", load_robot(name).link_names)


_SHEET_KEYS = ("title", "flange", "reach", "payload", "repeatability")


def _check_known(name: str) -> None:
    if name in ROBOT_NAMES:
        return
    near = difflib.get_close_matches(str(name).lower(), ROBOT_NAMES, n=1, cutoff=0.5)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    raise RobotError(
        f'unknown robot "{name}"; known: {", ".join(ROBOT_NAMES)}{hint}; one of your own '
        "is a path, such as ./my_arm.urdf"
    )
