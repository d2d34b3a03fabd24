"""The catalogue of arms: one folder of ``data/`` each, with URDF, meshes, shapes and data sheet."""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from armsight.errors import RobotError
from armsight.robots.loading import load_urdf
from armsight.robots.robot import Robot
from armsight.robots.shapes import BodyShapes, read_shapes

DATA = Path(__file__).parent / "data"
ROBOT_NAMES: tuple[str, ...] = ("ur3", "ur5", "ur10", "iiwa", "panda")
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


@cache
def load_robot(name: str) -> Robot:
    """An arm of the catalogue, without a tool. The same object every time; it is immutable.

    Raises:
        RobotError: there is no such arm (names the known ones), or its files are broken.
    """
    _check_known(name)
    return load_robot_folder(DATA / name)


def robot_sheet(name: str) -> RobotSheet:
    """Data sheet and source of an arm of the catalogue.

    Raises:
        RobotError: there is no such arm.
    """
    _check_known(name)
    data = _read_toml(DATA / name / "robot.toml")
    return RobotSheet(**{k: data[k] for k in _SHEET_KEYS}, **data["source"])


def robot_shapes(name: str) -> BodyShapes:
    """Shapes of an arm of the catalogue with the record of their fit."""
    return read_shapes(DATA / name / "shapes.json", load_robot(name).link_names)


def load_robot_folder(folder: Path) -> Robot:
    """An arm from a folder with ``robot.urdf``, ``robot.toml`` and, if there, ``shapes.json``.

    Raises:
        RobotError: a file is missing or broken.
    """
    data = _read_toml(folder / "robot.toml")
    try:
        limits = data["limits"]
        options: dict[str, Any] = {
            "name": folder.name,
            "flange": data["flange"],
            "acceleration": np.array(limits["acceleration"], float),
            "jerk": np.array(limits["jerk"], float),
            "home": np.array(data["home"], float),
            "reach": float(data["reach"]),
        }
    except KeyError as error:
        raise RobotError(f"{folder / 'robot.toml'}: {error} is missing") from None
    urdf = folder / "robot.urdf"
    shapes_file = folder / "shapes.json"
    if shapes_file.is_file():
        options["shapes"] = read_shapes(shapes_file, _link_names(urdf, data["flange"]))
    robot = load_urdf(urdf, **options)
    if robot.home.shape != (robot.n,):
        raise RobotError(
            f"{folder / 'robot.toml'}: home has {robot.home.size} values for {robot.n} joints"
        )
    return robot


_SHEET_KEYS = ("title", "flange", "reach", "payload", "repeatability")


def _check_known(name: str) -> None:
    if name in ROBOT_NAMES:
        return
    near = difflib.get_close_matches(str(name).lower(), ROBOT_NAMES, n=1, cutoff=0.5)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    raise RobotError(f'unknown robot "{name}"; known: {", ".join(ROBOT_NAMES)}{hint}')


def _link_names(urdf: Path, flange: str) -> tuple[str, ...]:
    from armsight.robots.chain import fold_chain
    from armsight.robots.urdf import read_urdf

    return tuple(link.name for link in fold_chain(read_urdf(urdf), flange=flange).links)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: is not TOML ({error})") from None
