"""V's Master: which sensor leads. Exactly as printed, and reported with its reasons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import inverse, transform
from armsight.servoing.sighting import Look

STALE = 0.6
"""A camera's look of longer ago says nothing any more [s]: three of V's periods."""


class Source(StrEnum):
    """Where the target's place comes from."""

    NONE = "none"
    TWO = "two closest"  # eye to hand: the two closest cameras that see it
    ALL = "all fixed"  # eye to hand: whoever sees it, when fewer than two of the closest do
    PAIR = "pair"  # eye in hand


@dataclass(frozen=True)
class Frustum:
    """What the pair can measure: 45 deg wide, 0.20 to 0.40 m (V).

    Attributes:
        near, far: [m]; half_width, half_height: of the view [rad].
    """

    near: float = 0.20
    far: float = 0.40
    half_width: float = math.radians(22.5)
    half_height: float = math.radians(15.45)

    def depth_inside(self, T_base_camera: Pose, point: Vector3) -> float:
        """How far inside a point of ``base`` lies [m]; below 0 outside."""
        x, y, z = transform(inverse(T_base_camera), np.asarray(point, float)[None])[0]
        if z <= 0.0:
            return -math.inf
        sides = [
            (z * math.tan(half) - abs(across)) * math.cos(half)
            for across, half in ((x, self.half_width), (y, self.half_height))
        ]
        return float(min(z - self.near, self.far - z, *sides))


@dataclass(frozen=True)
class Choice:
    """What the Master chose.

    Attributes:
        position: (3,) of the target in ``base`` [m], or None.
        stamp: exposure of the oldest picture in it [s].
        source: where it comes from; cameras: whose pictures; reason: of the last change.
    """

    position: Vector3 | None
    stamp: float
    source: Source
    cameras: tuple[str, ...]
    reason: str


class PaperMaster:
    """Eye to hand: the mean of the two closest cameras that see the target, all when that fails.

    To the pair when the target is inside its frustum by the hysteresis; back as soon as it leaves
    the frustum or the pair does not see it, without any.

    Args:
        frustum: of the pair; hysteresis: on the way in [m] (V: 5 cm).
        wrist: whether there is a pair to change to (V's comparison: fixed cameras only).

    Attributes:
        switches: times [s] of every change between eye to hand and eye in hand.
    """

    def __init__(
        self, frustum: Frustum | None = None, hysteresis: float = 0.05, wrist: bool = True
    ) -> None:
        self.frustum, self.hysteresis, self.wrist = frustum or Frustum(), hysteresis, wrist
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        self._newest: dict[str, Look] = {}
        self._in_hand = False
        self._reason = "nothing seen yet"
        self.switches: list[float] = []

    def add(self, look: Look) -> None:
        """What one camera saw."""
        old = self._newest.get(look.camera)
        if old is None or look.stamp > old.stamp:
            self._newest[look.camera] = look

    def choose(self, now: float) -> Choice:
        """Which sensors lead now, and where they say that the target is."""
        looks = [look for look in self._newest.values() if now - look.stamp < STALE]
        pair = next((look for look in looks if look.wrist), None) if self.wrist else None
        fixed = self._fixed([look for look in looks if not look.wrist])
        self._switch(now, pair, fixed)
        if self._in_hand and pair is not None and pair.sightings:
            place = pair.sightings[0].surface
            return Choice(place, pair.stamp, Source.PAIR, (pair.camera,), self._reason)
        return fixed

    def _switch(self, now: float, pair: Look | None, fixed: Choice) -> None:
        """Change over if the rules say so."""
        seen = pair is not None and bool(pair.sightings)
        inside = -math.inf
        if pair is not None:
            place = pair.sightings[0].surface if seen else fixed.position
            if place is not None:
                inside = self.frustum.depth_inside(pair.T_base_camera, place)
        if not self._in_hand and seen and inside > self.hysteresis:
            self._change(now, True, f"target {100 * inside:.0f} cm inside the pair's frustum")
        elif self._in_hand and not seen:
            self._change(now, False, "the pair does not see the target")
        elif self._in_hand and inside < 0.0:
            self._change(now, False, "the target has left the pair's frustum")

    def _change(self, now: float, in_hand: bool, reason: str) -> None:
        self._in_hand, self._reason = in_hand, reason
        self.switches.append(now)

    def _fixed(self, looks: list[Look]) -> Choice:
        """The mean of the two closest that see it; of all that do when fewer than two see it."""
        seeing = [look for look in looks if look.sightings]
        if not seeing:
            return Choice(None, -math.inf, Source.NONE, (), "no camera sees the target")
        rough = np.mean([look.sightings[0].surface for look in seeing], axis=0)
        by_distance = sorted(
            looks, key=lambda look: float(np.linalg.norm(look.T_base_camera[:3, 3] - rough))
        )
        closest = [look for look in by_distance if look.sightings][:2]
        source, used = (Source.TWO, closest) if len(closest) == 2 else (Source.ALL, seeing)
        place = np.mean([look.sightings[0].surface for look in used], axis=0)
        return Choice(
            np.asarray(place),
            min(look.stamp for look in used),
            source,
            tuple(look.camera for look in used),
            self._reason,
        )
