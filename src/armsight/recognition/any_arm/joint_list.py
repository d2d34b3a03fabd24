"""Joint angles of an arm in pictures, as a user writes them down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armsight.arrays import JointVector
from armsight.errors import UsageError
from armsight.robots.robot import Robot

_MOST_DEG = 720.0


def joints_of(degrees: Sequence[float], robot: Robot, where: str) -> JointVector:
    """(n,) joints [rad] of as many numbers in degrees.

    Raises:
        UsageError: there are too few or too many, or one is no angle.
    """
    if len(degrees) != robot.n:
        raise UsageError(
            f"{where}: {robot.name} has {robot.n} joints, {len(degrees)} numbers are given"
        )
    for k, value in enumerate(degrees):
        if not (math.isfinite(value) and abs(value) <= _MOST_DEG):
            raise UsageError(f"{where}: joint {k + 1} is {value}, expected an angle in degrees")
    return np.deg2rad(np.array(degrees, float))


def read_joints(file: Path, robot: Robot) -> dict[str, JointVector]:
    """Joints by the name of the picture, of lines ``picture, q1, ..., qn`` in degrees.

    Empty lines and such that begin with # are left out.

    Raises:
        UsageError: it cannot be read, a line is none of these, or a picture stands there twice.
    """
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: cannot be read ({error})") from None
    found: dict[str, JointVector] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"{file}, line {number}"
        name, *cells = (cell.strip() for cell in line.split(","))
        try:
            degrees = [float(cell) for cell in cells]
        except ValueError:
            raise UsageError(
                f"{where}: expected a picture's name and {robot.n} angles in degrees"
            ) from None
        if name in found:
            raise UsageError(f"{where}: {name} stands there twice")
        found[name] = joints_of(degrees, robot, where)
    return found
