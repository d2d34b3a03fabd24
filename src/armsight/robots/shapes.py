"""The body's shapes on disk: spheres, capsules and pairs of links, one JSON file a robot.

``shapes.json`` lies beside ``robot.urdf``; ``scripts/convert_robots.py`` and ``armsight robots
fit`` write it. Links are named as in the URDF, lengths are in metres:

* ``spheres``: ``{link: [[x, y, z, radius], ...]}``
* ``capsules``: ``{link: [[x0, y0, z0, x1, y1, z1, radius], ...]}``
* ``self_pairs``: pairs of links that can touch each other and are worth checking
* ``tool_pairs``: pairs worth checking as well once the last link carries a tool
* ``made_from``: hash of the files that they were fitted to, where armsight wrote it for a user
* ``fit``: how well the shapes fit the maker's full meshes, see :class:`FitReport`
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.errors import RobotError
from armsight.robots.robot import Capsules, Spheres


@dataclass(frozen=True)
class FitReport:
    """How well shapes fit a surface.

    Attributes:
        samples: points of the surface that were looked at.
        coverage: share of them inside the union of the shapes, 0..1.
        deepest_miss: how far the worst of them lies outside [m]; 0 when all are inside.
        overshoot_median, overshoot_p95, overshoot_max: distance [m] of the union's surface from
            the body, over points spread evenly on the union.
    """

    samples: int
    coverage: float
    deepest_miss: float
    overshoot_median: float
    overshoot_p95: float
    overshoot_max: float


@dataclass(frozen=True)
class BodyShapes:
    """All that ``shapes.json`` holds, links as indices of the chain.

    The fits are None where nobody measured them.
    """

    spheres: Spheres
    capsules: Capsules
    self_pairs: Ints
    tool_pairs: Ints
    sphere_fit: FitReport | None = None
    capsule_fit: FitReport | None = None


def _table(rows: list[tuple[int, list[float]]], width: int) -> Floats:
    """(k, width) numbers of (link, numbers) rows, a radius last.

    Raises:
        ValueError: a row has another number of numbers, one is not finite, or a radius below 0.
    """
    values = np.array([row for _, row in rows], float).reshape(len(rows), width)
    if not np.isfinite(values).all() or (values[:, -1:] < 0.0).any():
        raise ValueError("shapes have finite places and radii of 0 or more")
    return values


def make_spheres(rows: list[tuple[int, list[float]]]) -> Spheres:
    """Spheres from (link, [x, y, z, radius]) rows."""
    values = _table(rows, 4)
    return Spheres(
        np.array([link for link, _ in rows], np.int64), values[:, :3].copy(), values[:, 3].copy()
    )


def make_capsules(rows: list[tuple[int, list[float]]]) -> Capsules:
    """Capsules from (link, [x0, y0, z0, x1, y1, z1, radius]) rows."""
    values = _table(rows, 7)
    return Capsules(
        np.array([link for link, _ in rows], np.int64),
        values[:, :3].copy(),
        values[:, 3:6].copy(),
        values[:, 6].copy(),
    )


def read_shapes(path: Path, link_names: tuple[str, ...]) -> BodyShapes:
    """Read ``shapes.json``.

    Raises:
        RobotError: the file is missing, broken, or speaks of other links.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        index = {name: i for i, name in enumerate(link_names)}
        return BodyShapes(
            make_spheres(_rows(data["spheres"], index)),
            make_capsules(_rows(data["capsules"], index)),
            _pairs(data["self_pairs"], index),
            _pairs(data["tool_pairs"], index),
            *(_fit(data["fit"].get(key)) for key in ("spheres", "capsules")),
        )
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    except KeyError as error:
        raise RobotError(
            f"{path}: {error} is missing or not a link of the robot; "
            "fit the arm anew: armsight robots fit"
        ) from None
    except (ValueError, TypeError) as error:
        raise RobotError(f"{path}: is broken ({error}); restore it") from None


def made_from(path: Path) -> str:
    """The hash that ``shapes.json`` has of the files that it was fitted to; empty without one.

    Raises:
        RobotError: the file cannot be read, or is no JSON.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return str(data.get("made_from", ""))
    except OSError as error:
        raise RobotError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, AttributeError, RecursionError) as error:
        raise RobotError(f"{path}: is broken ({error}); restore it") from None


def shapes_json(shapes: BodyShapes, link_names: tuple[str, ...], mark: str = "") -> str:
    """The text of ``shapes.json``, one shape a line; ``mark`` becomes ``made_from``."""
    s, c = shapes.spheres, shapes.capsules
    spheres = np.column_stack([s.center, s.radius])
    capsules = np.column_stack([c.start, c.end, c.radius])
    parts = [f'"made_from": {json.dumps(mark)}'] if mark else []
    parts += [
        f'"spheres": {_by_link(s.link, spheres, link_names)}',
        f'"capsules": {_by_link(c.link, capsules, link_names)}',
    ]
    for key, pairs in (("self_pairs", shapes.self_pairs), ("tool_pairs", shapes.tool_pairs)):
        parts.append(f'"{key}": {json.dumps([[link_names[i] for i in pair] for pair in pairs])}')
    named = {"spheres": shapes.sphere_fit, "capsules": shapes.capsule_fit}
    fit = {key: asdict(value) for key, value in named.items() if value is not None}
    parts.append(f'"fit": {json.dumps(fit, indent=1)}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _fit(data: dict[str, Any] | None) -> FitReport | None:
    return None if data is None else FitReport(**data)


def _by_link(link: Ints, values: Any, names: tuple[str, ...]) -> str:
    blocks = []
    for i, name in enumerate(names):
        rows = [json.dumps([round(float(v), 5) for v in row]) for row in values[link == i]]
        if rows:
            blocks.append(f' "{name}": [\n  ' + ",\n  ".join(rows) + "\n ]")
    return "{\n" + ",\n".join(blocks) + "\n}"


def _rows(
    by_link: dict[str, list[list[float]]], index: dict[str, int]
) -> list[tuple[int, list[float]]]:
    return [(index[name], row) for name, rows in by_link.items() for row in rows]


def _pairs(names: list[list[str]], index: dict[str, int]) -> Ints:
    return np.array([[index[a], index[b]] for a, b in names], np.int64).reshape(-1, 2)
