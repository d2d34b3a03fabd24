"""What a camera says of a target: one record, whoever found it and however."""

from __future__ import annotations

from dataclasses import dataclass, field

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
    """

    stamp: float
    looks: tuple[Look, ...]
