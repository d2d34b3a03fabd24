"""What a task shows of itself, for a page, a recording and a replay that do not know the task."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np

from armsight.arrays import ColorImage, Floats, Points, Pose, Vector3

Color: TypeAlias = tuple[int, int, int]
"""Red, green, blue, 0..255."""
ORANGE: Color = (230, 120, 20)
MOST = 64
"""Figures, curves, pictures, marks or buttons of one face; more is a mistake."""


@dataclass(frozen=True)
class Figure:
    """A number of now: ``distance 12.3 mm``."""

    name: str
    value: float
    unit: str = ""


@dataclass(frozen=True)
class Curve:
    """A number whose last 30 s are drawn; ``value`` is that of now, NaN where there is none."""

    name: str
    value: float
    unit: str = ""


@dataclass(frozen=True)
class Picture:
    """An image to show: (h, w, 3) uint8 RGB."""

    name: str
    image: ColorImage


@dataclass(frozen=True)
class PointsMark:
    """(k, 3) points in ``base`` [m], drawn as balls of a radius [m]."""

    name: str
    points: Points
    radius: float = 0.01
    color: Color = ORANGE


@dataclass(frozen=True)
class ArrowMark:
    """An arrow in ``base`` from (3,) to (3,) [m]."""

    name: str
    start: Vector3
    end: Vector3
    color: Color = ORANGE


@dataclass(frozen=True)
class FrameMark:
    """The axes of a frame, ``length`` [m] long."""

    name: str
    T_base_mark: Pose
    length: float = 0.1


@dataclass(frozen=True)
class EllipsoidMark:
    """An ellipsoid in ``base``: its frame's axes are its own, half as long as (3,) ``radii`` [m].

    :meth:`of` makes it from a position's covariance.
    """

    name: str
    T_base_mark: Pose
    radii: Vector3
    color: Color = ORANGE

    @classmethod
    def of(
        cls, name: str, center: Vector3, covariance: Floats, sigmas: float = 2.0
    ) -> EllipsoidMark:
        """Where something is with (3, 3) covariance [m^2], out to so many standard deviations."""
        values, axes = np.linalg.eigh(np.asarray(covariance, float))
        if np.linalg.det(axes) < 0.0:
            axes = axes * np.array([1.0, 1.0, -1.0])
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = axes, center
        return cls(name, T, sigmas * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True)
class RegionMark:
    """A part of space: a box in ``base`` with (3,) whole edges ``size`` [m] about its frame."""

    name: str
    T_base_mark: Pose
    size: Vector3
    color: Color = ORANGE


Mark: TypeAlias = PointsMark | ArrowMark | FrameMark | EllipsoidMark | RegionMark
"""Something that is drawn in the scene."""


@dataclass(frozen=True)
class Button:
    """Something a person may press; ``Task.press(name)`` is told. Grey while not enabled."""

    name: str
    label: str
    enabled: bool = True


@dataclass(frozen=True)
class Face:
    """All that a task shows at one moment.

    Attributes:
        state: what it is doing, a word or two, such as ``approach``.
        reason: why, or what is wrong; may be empty.
        figures, curves, pictures, marks, buttons: see their classes; names are unique in each.
    """

    state: str = ""
    reason: str = ""
    figures: tuple[Figure, ...] = ()
    curves: tuple[Curve, ...] = ()
    pictures: tuple[Picture, ...] = ()
    marks: tuple[Mark, ...] = ()
    buttons: tuple[Button, ...] = ()


@dataclass(frozen=True)
class Trace:
    """What a curve was lately: (k,) times [s] and values."""

    name: str
    unit: str
    times: Floats
    values: Floats


@dataclass(frozen=True)
class ShownFace:
    """A task's face as a page or a recording gets it.

    Attributes:
        task: its name; stamp: when it looked so [s].
        face: as the task made it; traces: its curves over the last 30 s.
    """

    task: str
    stamp: float
    face: Face
    traces: tuple[Trace, ...] = ()


_VECTORS = {ArrowMark: ("start", "end"), EllipsoidMark: ("radii",), RegionMark: ("size",)}
_POSED = (FrameMark, EllipsoidMark, RegionMark)
_MARKS = (PointsMark, ArrowMark, FrameMark, EllipsoidMark, RegionMark)
_KINDS: dict[str, tuple[type, ...]] = {
    "figures": (Figure, Curve),
    "curves": (Figure, Curve),
    "pictures": (Picture,),
    "marks": _MARKS,
    "buttons": (Button,),
}


def face_fault(face: Any) -> str:
    """What is wrong with a face, in words; empty when it can be shown. Never raises."""
    if not isinstance(face, Face):
        return f"face() returned {type(face).__name__}; expected a Face"
    words: tuple[Any, ...] = (face.state, face.reason)
    if not all(isinstance(word, str) for word in words):
        return "state and reason must be text"
    for field in fields(Face)[2:]:
        parts = getattr(face, field.name)
        fault = _parts_fault(field.name, parts)
        if fault:
            return fault
    return ""


def _parts_fault(kind: str, parts: object) -> str:
    if not isinstance(parts, tuple) or len(parts) > MOST:
        return f"{kind} must be a tuple of at most {MOST}"
    names = [getattr(part, "name", None) for part in parts]
    if any(not isinstance(name, str) or not name for name in names):
        return f"every one of the {kind} needs a name"
    if len(set(names)) != len(names):
        return f"{kind} have the name {_twice(names)} twice"
    kinds: Any = _KINDS[kind]
    for part in parts:
        if not isinstance(part, kinds):
            return f"{kind}: {part.name}: a {type(part).__name__} is none of the {kind}"
        try:
            fault = _part_fault(part)
        except (TypeError, ValueError, OverflowError) as error:
            fault = str(error)
        if fault:
            return f"{kind}: {part.name}: {fault}"
    return ""


def _part_fault(part: Any) -> str:
    if isinstance(part, Figure | Curve):
        value: Any = part.value
        if isinstance(value, str) or np.ndim(value) != 0:
            return f"its value must be a number, not {value!r}"
        float(value)
        return "" if isinstance(part.unit, str) else "its unit must be text"
    if isinstance(part, Picture):
        image = np.asarray(part.image)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
            return f"an image must be (h, w, 3) uint8, not {image.shape} {image.dtype}"
        return ""
    if isinstance(part, Button):
        return "" if isinstance(part.label, str) else "its label must be text"
    return _mark_fault(part)


def _mark_fault(mark: Any) -> str:
    if isinstance(mark, FrameMark):
        if not (math.isfinite(mark.length) and mark.length > 0.0):
            return "its length must be above 0"
    elif not _is_color(mark.color):
        return f"its color is {mark.color!r}; expected red, green, blue of 0 to 255"
    if isinstance(mark, PointsMark):
        points = np.asarray(mark.points, float)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            return f"points must be finite (k, 3), not {points.shape}"
        return "" if math.isfinite(mark.radius) and mark.radius > 0 else "radius must be above 0"
    for field in _VECTORS.get(type(mark), ()):
        vector = np.asarray(getattr(mark, field), float)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            return f"{field} must be 3 finite numbers"
    if isinstance(mark, _POSED):
        T = np.asarray(mark.T_base_mark, float)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            return "T_base_mark must be a finite 4 x 4 pose"
    return ""


def _is_color(color: Any) -> bool:
    values = np.asarray(color)
    whole = values.shape == (3,) and values.dtype.kind in "iu"
    return whole and bool(((values >= 0) & (values <= 255)).all())


def _twice(names: Sequence[object]) -> str:
    return next(str(name) for name in names if names.count(name) > 1)
