"""The line of JSON that a labelled picture has in its shard.

Numbers are written with all their digits, so a row read is the row written. What a network learns
is checked here, for shape and for being finite; the rest (``scene_parameters``) is for statistics.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Mask, Points, Pose
from armsight.recognition.data.sample import NO_ROBOT, ROBOT_TYPES, is_robot_type


@dataclass(frozen=True)
class Row:
    """The labels of a sample, without its pictures: see :class:`Sample` for what they mean.

    ``image`` and ``links`` are names of files in the shard; ``scene_parameters`` holds numbers and
    words that describe how the picture came to be.
    """

    index: int
    seed: int
    scene: int
    robot: str
    image: str
    links: str
    width: int
    height: int
    K: Floats
    distortion: Floats
    T_camera_base: Pose
    q: JointVector
    joints_camera: Points
    keypoints_camera: Points
    keypoints_px: Floats
    keypoints_visible: Mask
    scene_parameters: dict[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawn:
    """A sample ready for the disk: its labels, its JPEG or PNG, the PNG of its link ids."""

    row: Row
    image: bytes
    links: bytes


def to_json(row: Row) -> str:
    """One line, without its end."""
    data = {name: getattr(row, name) for name in _PLAIN}
    for name in _SHAPES:
        data[name] = _listed(getattr(row, name))
    data["keypoints_visible"] = [bool(v) for v in row.keypoints_visible]
    data["scene_parameters"] = row.scene_parameters
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def from_json(line: str) -> Row:
    """The row of a line.

    Raises:
        ValueError: the line is no row; says what is wrong with it.
    """
    try:
        data = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not JSON ({error})") from None
    if not isinstance(data, dict):
        raise ValueError("is no JSON object")
    missing = [name for name in (*_PLAIN, *_SHAPES, "keypoints_visible") if name not in data]
    if missing:
        raise ValueError(f"lacks {missing[0]}")
    values: dict[str, Any] = {}
    for name, kind in _PLAIN.items():
        if not isinstance(data[name], kind) or isinstance(data[name], bool):
            raise ValueError(f"{name} is {data[name]!r}, expected {kind.__name__}")
        values[name] = data[name]
    for name, width in _SHAPES.items():
        values[name] = _array(name, data[name], width)
    visible = data["keypoints_visible"]
    if not isinstance(visible, list) or not all(isinstance(v, bool) for v in visible):
        raise ValueError("keypoints_visible is no list of true and false")
    values["keypoints_visible"] = np.array(visible, bool)
    values["scene_parameters"] = data.get("scene_parameters", {})
    row = Row(**values)
    _check(row)
    return row


_PLAIN: dict[str, type] = {
    "index": int,
    "seed": int,
    "scene": int,
    "robot": str,
    "image": str,
    "links": str,
    "width": int,
    "height": int,
}
_SHAPES: dict[str, int] = {
    "K": 3,
    "distortion": 0,
    "T_camera_base": 4,
    "q": 0,
    "joints_camera": 3,
    "keypoints_camera": 3,
    "keypoints_px": 2,
}
"""Columns of each array, 0 where it is a plain list."""


def _listed(values: Any) -> Any:
    """Nested lists, null for NaN, which JSON does not know."""
    if isinstance(values, np.ndarray):
        return [_listed(v) for v in values]
    number = float(values)
    return None if math.isnan(number) else number


def _array(name: str, data: Any, columns: int) -> Floats:
    try:
        values = np.array(
            [[_number(v) for v in row] for row in data] if columns else [_number(v) for v in data],
            np.float64,
        )
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} holds something that is no number") from None
    if len(values) == 0:
        return np.empty((0, columns)) if columns else np.empty(0)
    if columns and (values.ndim != 2 or values.shape[1] != columns):
        raise ValueError(f"{name} has shape {values.shape}, expected {columns} columns")
    return values


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)


def _check(row: Row) -> None:
    """Shapes agree with one another, and what must be finite is."""
    if not is_robot_type(row.robot):
        raise ValueError(f'robot "{row.robot}" is unknown; known: {", ".join(ROBOT_TYPES)}')
    for name in (row.image, row.links):
        # Names come from a file: nothing outside the shard's folder may be opened through them.
        if name.startswith(("/", "\\")) or ".." in name or ":" in name:
            raise ValueError(f'file name "{name}" leaves the shard')
    if not (0 < row.width <= 16384 and 0 < row.height <= 16384):
        raise ValueError(f"a picture of {row.width} x {row.height} pixels is absurd")
    shapes = {
        "K": (row.K, (3, 3)),
        "T_camera_base": (row.T_camera_base, (4, 4)),
        "distortion": (row.distortion, (5,)),
        "joints_camera": (row.joints_camera, (len(row.q), 3)),
        "keypoints_px": (row.keypoints_px, (len(row.keypoints_camera), 2)),
        "keypoints_visible": (row.keypoints_visible, (len(row.keypoints_camera),)),
    }
    for name, (values, shape) in shapes.items():
        if values.shape != shape:
            raise ValueError(f"{name} has shape {values.shape}, expected {shape}")
    finite = [row.K, row.distortion, row.q, row.joints_camera, row.keypoints_camera]
    if row.robot != NO_ROBOT:
        finite.append(row.T_camera_base)
    if not all(np.isfinite(values).all() for values in finite):
        raise ValueError("holds a number that is not finite")
    if row.K[0, 0] <= 0 or row.K[1, 1] <= 0:
        raise ValueError("K has a focal length that is not positive")
