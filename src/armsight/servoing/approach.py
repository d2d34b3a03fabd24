"""How the tip comes to what it shall touch: along the tool's axis, down a funnel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Vector3
from armsight.geometry.pose import cross
from armsight.servoing.aim import Aim

ASIDE = math.radians(30.0)
"""A tip on springs touches what is round from so far off the tool's axis, too [rad]."""
STRAIGHT = math.radians(10.0)
"""A tool that points so far from where it should comes along where it should [rad]."""


@dataclass(frozen=True)
class Funnel:
    """The tip may be this near only if it is aligned.

    Attributes:
        gap: final distance of the tip from the touched point along the axis [m]; below 0 presses,
            which a tip does that is aligned: half of ``free`` beside the axis in full, from
            ``free`` on not at all.
        slope: stand-off for each metre beside the axis [1].
        free: that far beside the axis costs no stand-off [m].
        most: greatest stand-off [m].
    """

    gap: float = 0.0
    slope: float = 1.2
    free: float = 0.008
    most: float = 0.12

    def standoff(
        self, tip: Vector3, touched: Vector3, axis: Vector3, beside: float | None = None
    ) -> float:
        """How far before the touched point the tip shall be now [m].

        Args:
            tip: (3,) where it is [m].
            touched: (3,) the point [m].
            axis: (3,) unit, the tool's.
            beside: how far the tip counts as beside its way [m]; None for beside the axis.
        """
        to = touched - tip
        if beside is None:
            beside = float(np.linalg.norm(to - axis * (axis @ to)))
        past = max(float(-(axis @ to)), 0.0)  # behind the point already: go back first
        extra = self.slope * max(beside - self.free, 0.0) + (self.most if past > 0.02 else 0.0)
        aligned = (
            min(max(2.0 - 2.0 * beside / max(self.free, 1e-9), 0.0), 1.0) if self.gap < 0.0 else 1.0
        )
        return aligned * self.gap + min(extra, self.most)


def facing(
    place: Vector3, base_axis: Vector3, front: Vector3, widest: float = np.deg2rad(60.0)
) -> Vector3:
    """Horizontal direction from the arm's axis to a place, held to the operator's side (V's a*).

    Args:
        place: (3,) the target, in ``base`` [m].
        base_axis: (3,) unit: the vertical in ``base``.
        front: (3,) unit: towards the side where the person stands, in ``base``.
        widest: greatest angle from ``front`` [rad].
    """
    flat = place - base_axis * (base_axis @ place)
    length = math.sqrt(float(flat @ flat))
    if length < 0.05:
        return front
    flat = flat / length
    side = cross(base_axis, front)
    angle = math.atan2(float(flat @ side), float(flat @ front))
    angle = min(max(angle, -widest), widest)
    return np.asarray(math.cos(angle) * front + math.sin(angle) * side)


def along_the_tool(axis: Vector3, tool: Vector3 | None) -> Vector3:
    """The way (3,) to what may be touched from any side, if the tool points elsewhere than wished.

    Under a ceiling it points up: along the wished way its shaft would graze a ball.
    """
    if tool is None:
        return axis
    between = math.acos(float(np.clip(tool @ axis, -1.0, 1.0)))
    share = max(between - STRAIGHT, 0.0) / max(between, 1e-6)
    mixed = (1.0 - share) * axis + share * tool
    return np.asarray(mixed / max(float(np.linalg.norm(mixed)), 1e-9))


def side(tip: Vector3, middle: Vector3, axis: Vector3) -> tuple[Vector3, float]:
    """From where a round target is touched by a tip that may be pushed from any side.

    Args:
        tip: (3,) where it is [m].
        middle: (3,) of the target [m].
        axis: (3,) unit, the tool's.

    Returns:
        (3,) unit, the way from the tip to the middle, if that is no more than :data:`ASIDE` off the
        tool's axis, else the nearest that is; and how far the tip is beside that way [m].
    """
    to = middle - tip
    away = math.sqrt(float(to @ to))
    way = to / max(away, 1e-9)
    angle = math.acos(float(np.clip(way @ axis, -1.0, 1.0)))
    if angle <= ASIDE:
        return way, 0.0
    across = way - float(way @ axis) * axis
    across = across / max(math.sqrt(float(across @ across)), 1e-9)
    way = math.cos(ASIDE) * axis + math.sin(ASIDE) * across
    return way, away * math.sin(min(angle - ASIDE, 0.5 * math.pi))


def touch_aim(
    tip: Vector3,
    touched: Vector3,
    velocity: Vector3,
    axis: Vector3,
    down: Vector3,
    funnel: Funnel,
    beside: float | None = None,
) -> Aim:
    """The aim of a tip that shall touch a moving point along an axis; see :class:`Funnel`."""
    standoff = funnel.standoff(tip, touched, axis, beside)
    return Aim(touched - standoff * axis, velocity, axis, down)
