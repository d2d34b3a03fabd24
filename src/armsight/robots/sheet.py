"""``robot.toml``: what a URDF cannot say of an arm."""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.errors import RobotError
from armsight.robots.loading import DEFAULT_ACCELERATION, DEFAULT_JERK


@dataclass(frozen=True)
class ArmSheet:
    """What ``robot.toml`` adds to a URDF. All of it may be left out.

    Attributes:
        flange, base: links, see :func:`~armsight.robots.chain.fold_chain`.
        held: values of moving joints off the chain [rad or m].
        packages: folders that ``package://NAME/`` stands for.
        velocity [rad/s], in place of the URDF's; acceleration [rad/s^2], jerk [rad/s^3]: a value,
            or one a joint.
        home: [rad], one a joint; reach: [m].
    """

    flange: str | None = None
    base: str | None = None
    held: dict[str, float] = field(default_factory=dict)
    packages: dict[str, Path] = field(default_factory=dict)
    velocity: Floats | float | None = None
    acceleration: Floats | float = DEFAULT_ACCELERATION
    jerk: Floats | float = DEFAULT_JERK
    home: Floats | None = None
    reach: float | None = None


def read_sheet(path: Path | None) -> ArmSheet:
    """An arm's ``robot.toml``; defaults where there is none.

    Raises:
        RobotError: it is no TOML, or a value is of the wrong kind.
    """
    if path is None:
        return ArmSheet()
    data = read_toml(path)
    unknown = next((key for key in data if key not in (*_KEYS, *_TITLES)), None)
    if unknown is not None:
        near = difflib.get_close_matches(unknown, _KEYS, n=1)
        hint = f'did you mean "{near[0]}"?' if near else f"known: {', '.join(_KEYS)}"
        raise RobotError(f'{path}: unknown key "{unknown}"; {hint}')
    limits = _table(data, "limits", path)
    packages = _table(data, "packages", path)
    folder = path.parent
    return ArmSheet(
        flange=_text(data, "flange", path),
        base=_text(data, "base", path),
        held={k: _number(v, f"held.{k}", path) for k, v in _table(data, "held", path).items()},
        packages={k: folder / str(v) for k, v in packages.items()},
        velocity=_limit(limits, "velocity", path) if "velocity" in limits else None,
        acceleration=_limit(limits, "acceleration", path, DEFAULT_ACCELERATION),
        jerk=_limit(limits, "jerk", path, DEFAULT_JERK),
        home=_numbers(data["home"], "home", path) if "home" in data else None,
        reach=_number(data["reach"], "reach", path) if "reach" in data else None,
    )


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file.

    Raises:
        RobotError: it cannot be read or is none.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{path}: is not TOML ({error})") from None


_KEYS = ("flange", "base", "home", "reach", "limits", "held", "packages")
_TITLES = ("title", "payload", "repeatability", "source")  # for the catalogue's table


def _table(data: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise RobotError(f"{path}: {key} must be a table, [{key}]")
    return table


def _text(data: dict[str, Any], key: str, path: Path) -> str | None:
    value = data.get(key)
    if value is not None and not isinstance(value, str):
        raise RobotError(f"{path}: {key} must be the name of a link, found {value!r}")
    return value


def _limit(
    limits: dict[str, Any], key: str, path: Path, default: float | None = None
) -> Floats | float:
    value = limits.get(key, default)
    if isinstance(value, list):
        return _numbers(value, f"limits.{key}", path)
    return _number(value, f"limits.{key}", path)


def _numbers(value: Any, key: str, path: Path) -> Floats:
    if not isinstance(value, list):
        raise RobotError(f"{path}: {key} must be a list of numbers, found {value!r}")
    return np.array([_number(v, key, path) for v in value])


def _number(value: Any, key: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise RobotError(f"{path}: {key} must be finite numbers, found {value!r}")
    return float(value)
