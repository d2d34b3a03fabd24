"""The bodies of people: shapes for each part, and the poses of the parts from the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.arrays import Floats
from armsight.simulation.gl import mujoco
from armsight.simulation.skeleton import PARTS, Proportions


@dataclass(frozen=True)
class BodyShape:
    """A capsule or ellipsoid of a body part, in the part's frame.

    The frame: z from joint to joint, x forward (hands: back of the hand), y to the left.

    Attributes:
        kind: ``capsule`` from ``a`` to ``b`` or ``ellipsoid`` about ``a`` with half axes ``b``.
        a, b: (3,) [m].
        radius: of a capsule [m].
        look: skin, hair, shirt, trousers or shoes.
    """

    kind: Literal["capsule", "ellipsoid"]
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float
    look: str

    def geom(self) -> dict[str, Any]:
        """MuJoCo's description."""
        if self.kind == "ellipsoid":
            return {"type": mujoco.mjtGeom.mjGEOM_ELLIPSOID, "size": self.b, "pos": self.a}
        return {
            "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
            "size": [self.radius, 0, 0],
            "fromto": [*self.a, *self.b],
        }


@dataclass(frozen=True)
class BodyPart:
    """A rigid part of a person; see :data:`skeleton.PARTS` for its frame."""

    name: str
    shapes: tuple[BodyShape, ...]


@dataclass(frozen=True)
class PersonBody:
    """Everything of a person that cameras see and the arm can touch."""

    name: str
    parts: tuple[BodyPart, ...]


def person_body(name: str, p: Proportions) -> PersonBody:
    """A clothed adult of the given proportions."""
    s = p.height / 1.75
    shapes: dict[str, tuple[BodyShape, ...]] = {
        "torso": _torso(p, s),
        "head": _head(p, s),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        shapes[f"{side}_upper_arm"] = (_bone(p.upper_arm, 0.050 * s, "shirt"),)
        shapes[f"{side}_forearm"] = (
            _bone(0.45 * p.forearm, 0.044 * s, "shirt"),
            _bone(p.forearm, 0.036 * s, "skin"),
        )
        shapes[f"{side}_hand"] = _hand(p, s, sign)
        shapes[f"{side}_thigh"] = (_bone(p.thigh, 0.077 * s, "trousers"),)
        shapes[f"{side}_shin"] = (_bone(p.shin, 0.055 * s, "trousers"),)
        shapes[f"{side}_foot"] = (
            _capsule((-0.02 * s, 0, -0.035 * s), (-0.02 * s, 0, 0.75 * p.foot), 0.042 * s, "shoes"),
        )
    return PersonBody(name, tuple(BodyPart(part, shapes[part]) for part, *_ in PARTS))


def hand_body(name: str, p: Proportions) -> PersonBody:
    """A lone forearm and hand; the parts are those of a person's right arm."""
    whole = person_body(name, p)
    parts = [q for q in whole.parts if q.name in ("right_forearm", "right_hand")]
    return PersonBody(name, tuple(parts))


def _torso(p: Proportions, s: float) -> tuple[BodyShape, ...]:
    t, w = p.trunk, p.shoulder_half
    return (
        _capsule((0, -0.07 * s, -0.03), (0, 0.07 * s, -0.03), 0.115 * s, "trousers"),
        _ellipsoid((0.01, 0, 0.30 * t), (0.115 * s, 0.155 * s, 0.42 * t), "shirt"),
        _ellipsoid((0.01, 0, 0.66 * t), (0.120 * s, 0.175 * s, 0.40 * t), "shirt"),
        _capsule((0, -0.8 * w, 0.86 * t), (0, 0.8 * w, 0.86 * t), 0.066 * s, "shirt"),
        _capsule((0, -0.3 * w, 0.93 * t), (0, 0.3 * w, 0.93 * t), 0.060 * s, "shirt"),
    )


def _head(p: Proportions, s: float) -> tuple[BodyShape, ...]:
    h = p.neck_to_head
    return (
        _capsule((-0.01, 0, -0.02), (0, 0, 0.7 * h), 0.054 * s, "skin"),
        _ellipsoid((0, 0, h), (0.095 * s, 0.075 * s, 0.118 * s), "skin"),
        _ellipsoid((-0.018 * s, 0, h + 0.024 * s), (0.090 * s, 0.081 * s, 0.105 * s), "hair"),
        _ellipsoid((0.094 * s, 0, h - 0.012 * s), (0.016 * s, 0.012 * s, 0.022 * s), "skin"),
    )


def _hand(p: Proportions, s: float, sign: float) -> tuple[BodyShape, ...]:
    h = p.hand
    fingers = tuple(
        _capsule(
            (0, y * s, 0.9 * h),
            (-0.012 * s, 1.15 * y * s, 0.9 * h + length * s),
            0.0095 * s,
            "skin",
        )
        for y, length in ((0.029, 0.066), (0.010, 0.076), (-0.010, 0.071), (-0.029, 0.055))
    )
    thumb = _capsule(
        (0, -sign * 0.028 * s, 0.25 * h), (0, -sign * 0.068 * s, 0.85 * h), 0.012 * s, "skin"
    )
    return (_ellipsoid((0, 0, 0.52 * h), (0.019 * s, 0.043 * s, 0.62 * h), "skin"), *fingers, thumb)


def _bone(length: float, radius: float, look: str) -> BodyShape:
    return _capsule((0.0, 0.0, 0.0), (0.0, 0.0, length), radius, look)


def _capsule(a: Any, b: Any, radius: float, look: str) -> BodyShape:
    return BodyShape("capsule", a, b, radius, look)


def _ellipsoid(center: Any, half: Any, look: str) -> BodyShape:
    return BodyShape("ellipsoid", center, half, 0.0, look)


def hidden() -> Floats:
    """(7,) pose far under the floor, for parts that are not there: position, quaternion wxyz."""
    return np.array([0.0, 0.0, -10.0, 1.0, 0.0, 0.0, 0.0])
