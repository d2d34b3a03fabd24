"""What a camera says of a target: one record, whoever found it and however."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, Floats, Pose, Vector3


@dataclass(frozen=True)
class Sighting:
    """A target in the pictures of one camera, or of one pair.

    Attributes:
        target: what it is, such as ``ball``.
        camera: who saw it.
        stamp: exposure [s].
        position: (3,) the point that is aimed at, in ``base`` [m].
        covariance: (3, 3) of it [m^2]: random error alone, the camera's own place is not in it.
        lasting: standard deviation of an error that the next sightings of this camera share [m]: of
            what is remembered, or guessed of what is hidden.
        surface: (3,) mean of the visible surface in ``base`` [m]: V's estimate of the place.
        normal: (3,) outward, where the target has a face; None for a ball.
        wrist: seen by the pair on the arm.
        tilt: standard deviation of the normal [rad].
        along: (3,) unit: where it goes on beyond its point, as a hand does in a forearm; or None.
    """

    target: str
    camera: str
    stamp: float
    position: Vector3
    covariance: Floats
    surface: Vector3
    normal: Vector3 | None = None
    wrist: bool = False
    tilt: float = 0.0
    along: Vector3 | None = None
    lasting: float = 0.0


@dataclass(frozen=True)
class Look:
    """One camera looked, and saw the target or not.

    Attributes:
        camera: which; stamp: exposure [s]; wrist: it is the pair on the arm.
        T_base_camera: where it was then.
        sightings: what it saw, the most believable first; empty for nothing.
        mark: where it saw the mark on the tool, (3,) in ``base`` [m], less where the joints say
            that the mark was: the error of the camera's place; None where it saw none.
        mark_covariance: (3, 3) of that [m^2].
        picture: what it looked at, with what it found drawn in; None unless somebody watches.
    """

    camera: str
    stamp: float
    wrist: bool
    T_base_camera: Pose
    sightings: tuple[Sighting, ...] = ()
    mark: Vector3 | None = None
    mark_covariance: Floats = field(default_factory=lambda: np.eye(3))
    picture: ColorImage | None = None


@dataclass(frozen=True)
class Looks:
    """What a perceiver found in the pictures of one round.

    Attributes:
        stamp: exposure of the oldest [s].
        looks: one a camera.
        warning: what people should read, such as a sighting that cannot be; empty when all is well.
    """

    stamp: float
    looks: tuple[Look, ...]
    warning: str = ""


def believable(found: Iterable[Any]) -> tuple[tuple[Sighting, ...], str]:
    """Those of a detector's sightings that can be, and what is wrong with the others, in words.

    A detector may be anybody's. One place that is not a number would stay in the estimate for good.
    """
    judged = [(sighting, sighting_fault(sighting)) for sighting in found]
    wrong = next((fault for _, fault in judged if fault), "")
    return tuple(sighting for sighting, fault in judged if not fault), wrong


def sighting_fault(sighting: Any) -> str:
    """What is wrong with a sighting, in words; empty when nothing is. Never raises."""
    if not isinstance(sighting, Sighting):
        return f"a detector found a {type(sighting).__name__}; expected a Sighting"
    name = f"a sighting of {sighting.target}"
    for field_ in ("position", "surface", "normal", "along"):
        value = getattr(sighting, field_)
        unit = field_ in ("normal", "along")
        if value is None and unit:
            continue
        if not _is_vector(value):
            return f"{name}: its {field_} must be an array of 3 finite numbers, not {value!r}"
        if unit and abs(float(value @ value) - 1.0) > 1e-3:
            return f"{name}: its {field_} is {value.tolist()}; expected a unit vector"
    C = sighting.covariance
    if not (isinstance(C, np.ndarray) and C.shape == (3, 3) and _finite(C)):
        return f"{name}: its covariance must be an array of 3 x 3 finite numbers [m^2]"
    symmetric = (np.abs(C - C.T) <= 1e-12 + 1e-5 * np.abs(C)).all()
    if not symmetric or np.linalg.eigvalsh(C)[0] < -1e-12:
        return f"{name}: its covariance is not symmetric and positive"
    for field_, unit_ in (("tilt", "rad"), ("lasting", "m")):
        size = getattr(sighting, field_)
        if not isinstance(size, int | float) or not 0.0 <= size < np.inf:
            return f"{name}: its {field_} is {size!r} {unit_}; expected 0 or more"
    return ""


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.shape == (3,) and _finite(value)


def _finite(values: Floats) -> bool:
    """Whether numbers are all finite; what holds no numbers is not."""
    return values.dtype.kind in "fiu" and bool(np.isfinite(values).all())
