"""Poses in YAML, JSON and XML: mappings, lists and matrices, however they are nested."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.table import PoseTable, read_text
from armsight.errors import CalibrationError

DEEPEST = 12
"""Levels of nesting that are looked into."""


class _NamedTwice(yaml.constructor.ConstructorError):
    """A mapping has a name more than once; ``problem`` says which."""


class _OpenCvLoader(yaml.CSafeLoader if hasattr(yaml, "CSafeLoader") else yaml.SafeLoader):  # type: ignore[misc]
    """Safe YAML that reads OpenCV's matrices as plain mappings, and takes no name twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        first: dict[str, Any] = {}
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            if not isinstance(key, yaml.ScalarNode) or key.value not in first:
                first.setdefault(str(key.value), value)
                continue
            old = self.construct_object(first[key.value], deep=True)
            if self.construct_object(value, deep=True) != old:
                mark = key.start_mark
                raise _NamedTwice(None, None, _twice(key.value), mark)
        return dict(super().construct_mapping(node, deep=deep))


def _twice(name: str) -> str:
    return f'has "{name}" more than once, with different values; keep the right one'


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object that has each name once.

    Raises:
        KeyError: not so; in words.
    """
    out: dict[str, Any] = {}
    for name, value in pairs:
        if out.setdefault(name, value) != value:
            raise KeyError(_twice(name))
    return out


_OpenCvLoader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True),
)


def read_yaml(file: Path) -> Any:
    """A YAML file, OpenCV's dialect included.

    Raises:
        CalibrationError: it cannot be read.
    """
    text = read_text(file)
    if text.startswith("%YAML:"):  # OpenCV's header is not YAML's
        text = text.split("\n", 1)[1] if "\n" in text else ""
    try:
        # ROS prints one document after the other.
        found = [d for d in yaml.load_all(text, Loader=_OpenCvLoader) if d is not None]
        return found if len(found) > 1 else found[0] if found else None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        words = error.problem if isinstance(error, _NamedTwice) else "is not valid YAML"
        raise CalibrationError(f"{file}{where}: {words}") from None


def read_document(file: Path) -> Any:
    """A YAML, JSON or XML file as mappings and lists.

    Raises:
        CalibrationError: it cannot be read.
    """
    suffix = file.suffix.lower()
    if suffix == ".json":
        try:
            return json.loads(read_text(file), object_pairs_hook=_once)
        except KeyError as error:
            raise CalibrationError(f"{file}: {error.args[0]}") from None
        except (ValueError, RecursionError) as error:
            raise CalibrationError(f"{file}: is not valid JSON: {error}") from None
    if suffix == ".xml":
        return _xml(file)
    return read_yaml(file)


def _xml(file: Path) -> Any:
    try:
        root = ET.fromstring(read_text(file))  # noqa: S314  (expat bounds entity expansion)
    except (ET.ParseError, ValueError) as error:
        raise CalibrationError(f"{file}: is not valid XML: {error}") from None

    def value(element: ET.Element, depth: int) -> Any:
        if depth > DEEPEST:
            return None
        if not len(element):
            words = (element.text or "").split()
            try:
                numbers = [float(w) for w in words]
            except ValueError:
                return element.text
            return numbers[0] if len(numbers) == 1 else numbers
        return {child.tag: value(child, depth + 1) for child in element}

    return value(root, 0)


def structured_tables(document: Any, source: str) -> list[PoseTable]:
    """Tables of poses in a document: each list or mapping whose entries are poses."""
    out: list[PoseTable] = []
    for entries in _collections(document, 0):
        table = _joined(entries, source)
        if table is not None:
            out.append(table)
    return out


def _collections(value: Any, depth: int) -> Iterator[list[tuple[str, Any]]]:
    """Lists of (key, entry) that may each be poses, outermost first; then the document itself."""
    if depth > DEEPEST:
        return
    if isinstance(value, list):
        yield [("", v) for v in value]
        if value and isinstance(value[0], list | dict):
            # Samples that hold a pose each beside other things: the same key of each.
            if all(isinstance(v, dict) for v in value):
                for key in value[0]:
                    inner = [v.get(key) for v in value]
                    if all(isinstance(i, dict | list) for i in inner):
                        yield from _collections([_keyed(v, i) for v, i in zip(value, inner)], 9)
            return
    if isinstance(value, dict):
        yield [("", value)]
        yield [(str(k), v) for k, v in value.items()]
        for v in value.values():
            if isinstance(v, dict | list):
                yield from _collections(v, depth + 1)


def _keyed(entry: dict[Any, Any], inner: Any) -> Any:
    """A sample's pose with the sample's own name, so that it finds its picture."""
    if isinstance(inner, dict):
        return {**{k: v for k, v in entry.items() if isinstance(v, str | int)}, **inner}
    return inner


def _joined(entries: list[tuple[str, Any]], source: str) -> PoseTable | None:
    rows: list[tuple[str, list[float], tuple[str, ...] | None, list[float] | None]] = []
    for key, value in entries:
        pose = pose_of(value)
        if pose is None:
            if rows or len(entries) < 2:
                return None
            continue
        name, numbers, names, joints = pose
        if rows and (order := order_of(names, rows[0][2])) is not None:
            numbers, names = [numbers[i] for i in order], rows[0][2]
        rows.append((name or key, numbers, names, joints))
    if not rows or len({(len(r[1]), r[2]) for r in rows}) != 1:
        return None
    if len(rows) < 0.6 * len(entries):
        return None
    angles = [r[3] for r in rows if r[3] is not None]
    whole = len(angles) == len(rows) and len({len(a) for a in angles}) == 1
    columns = Columns(rows[0][2]) if rows[0][2] is not None else None
    values = np.array([r[1] for r in rows], float)
    if columns is not None and columns.pose:
        values = values[:, columns.pose]
        return PoseTable(
            source,
            tuple(str(r[0]) for r in rows),
            values,
            columns.names,
            columns.length,
            columns.angle,
            columns.rotation,
            np.array(angles, float) if whole else None,
        )
    return PoseTable(
        source,
        tuple(str(r[0]) for r in rows),
        values,
        joints=np.array(angles, float) if whole else None,
    )


def order_of(names: tuple[str, ...] | None, first: tuple[str, ...] | None) -> list[int] | None:
    """Where each of the first pose's names stands among others; None where they are not the same.

    A mapping has no order.
    """
    if names is None or first is None or sorted(names) != sorted(first):
        return None
    return [names.index(name) for name in first]


Pose = tuple[str, list[float], tuple[str, ...] | None, list[float] | None]

_NAMES = ("image", "file", "filename", "file_path", "image_file", "image_path", "name", "picture")
_POSITIONS = ("position", "translation", "trans", "t", "tvec", "pos", "xyz", "point", "origin")
_ROTATIONS = (
    *("orientation", "rotation", "quaternion", "quat", "rot", "r", "rvec", "rotvec", "rpy"),
    *("euler", "angles", "q"),
)


def pose_of(value: Any) -> Pose | None:
    """The picture's name, numbers, their names and joints of one entry; None when it is no pose."""
    numbers = _numbers(value)
    if numbers is not None:
        return ("", numbers, None, None) if len(numbers) in (6, 7, 12, 16) else None
    if not isinstance(value, dict):
        return None
    lower = {str(k).strip().lower(): v for k, v in value.items()}
    name = next((str(lower[k]) for k in _NAMES if isinstance(lower.get(k), str | int)), "")
    joints = next(
        (j for k, v in lower.items() if _of_joints(k) and (j := _numbers(v)) and 5 <= len(j) <= 8),
        None,
    )
    scalars = {k: float(v) for k, v in lower.items() if _is_number(v)}
    for inner in _pieces(lower):
        scalars.update(inner)
    place = next((n for k in _POSITIONS if (n := _numbers(lower.get(k))) and len(n) == 3), None)
    if place is not None and not {"x", "y", "z"} & set(scalars):
        scalars.update(zip("xyz", place))  # a list beside a rotation with names
    columns = Columns(list(scalars))
    if columns.pose:
        return name, list(scalars.values()), tuple(scalars), joints
    rotation = next(
        ((k, n) for k in _ROTATIONS if (n := _numbers(lower.get(k))) and len(n) in (3, 4, 9)),
        None,
    )
    if place is not None and rotation is not None:
        key, turn = rotation
        said = {"rvec": "rvec", "rotvec": "rvec", "rpy": "rpy"}.get(key)
        if said == "rpy":
            return name, place + turn, ("x", "y", "z", "roll", "pitch", "yaw"), joints
        if said == "rvec" and len(turn) == 3:
            return name, place + turn, ("x", "y", "z", "rvx", "rvy", "rvz"), joints
        if len(turn) == 9:
            rows = [[*turn[3 * i : 3 * i + 3], place[i]] for i in range(3)]
            return name, [v for row in rows for v in row], None, joints
        return name, place + turn, None, joints
    for key, inner in lower.items():
        if key in ("header", "stamp", "covariance") or "camera" in key or "object" in key:
            continue
        if _of_joints(key):
            continue
        if isinstance(inner, dict | list):
            pose = pose_of(inner)
            if pose is not None:
                return name or pose[0], pose[1], pose[2], joints or pose[3]
    return None


def _of_joints(key: str) -> bool:
    return "joint" in key or key in ("q", "qpos", "actual_q", "target_q", "j", "axes")


def poses_of_one(document: Any, source: str) -> dict[str, PoseTable]:
    """Every pose of a document that belongs to one picture, by the name that it has there."""
    out: dict[str, PoseTable] = {}
    if isinstance(document, dict):
        besides = {k: v for k, v in document.items() if _of_joints(str(k).lower())}
        for key, inner in document.items():
            if key in besides or pose_of(inner) is None:
                continue
            table = _joined([("", {key: inner, **besides})], source)
            if table is not None:
                out[str(key)] = table
    if not out:
        for table in structured_tables(document, source):
            if len(table.values) == 1:
                return {"": table}
    return out


def _pieces(lower: dict[str, Any]) -> Iterator[dict[str, float]]:
    """``position: {x, y, z}`` and ``orientation: {x, y, z, w}`` as flat names."""
    for key, inner in lower.items():
        if not isinstance(inner, dict):
            continue
        cells = {str(k).lower(): float(v) for k, v in inner.items() if _is_number(v)}
        if key in _POSITIONS and {"x", "y", "z"} <= set(cells):
            yield {a: cells[a] for a in "xyz"}
        elif key in _ROTATIONS and {"x", "y", "z", "w"} <= set(cells):
            yield {f"q{a}": cells[a] for a in "xyzw"}
        elif key in _ROTATIONS and {"x", "y", "z"} <= set(cells):
            yield {f"r{a}": cells[a] for a in "xyz"}
        elif key in _ROTATIONS and len(cells) in (3, 4):
            yield cells


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _numbers(value: Any) -> list[float] | None:
    """Numbers of a flat or nested list, or of a matrix that is written as a mapping."""
    if isinstance(value, dict):
        keys = {str(k).lower() for k in value}
        if "data" in keys and keys <= {"data", "rows", "cols", "dt", "layout", "type_id"}:
            return _numbers(value.get("data", value.get("Data")))
        return None
    if not isinstance(value, list) or not value or len(value) > 64:
        return None
    flat: list[float] = []
    for v in value:
        if _is_number(v):
            flat.append(float(v))
        elif isinstance(v, list):
            inner = _numbers(v)
            if inner is None:
                return None
            flat += inner
        else:
            return None
    return flat if len(flat) <= 64 else None
