"""The bodies of people: lofts for each part, the same for what cameras see and the arm touches.

Widths are those of an adult of 1.75 m in work clothes, drawn by eye; lengths follow
:class:`skeleton.Proportions`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats
from armsight.simulation.loft import Loft, loft
from armsight.simulation.skeleton import PARTS, Proportions

STANDARD = Proportions(1.75)
"""The person whose widths the tables give."""


@dataclass(frozen=True)
class BodyPart:
    """A rigid part of a person; see :data:`skeleton.PARTS` for its frame.

    The frame: z from joint to joint, x forward (hands: back of the hand up), y to the left.
    """

    name: str
    lofts: tuple[Loft, ...]


@dataclass(frozen=True)
class PersonBody:
    """Everything of a person that cameras see and the arm can touch."""

    name: str
    parts: tuple[BodyPart, ...]


def person_body(name: str, p: Proportions) -> PersonBody:
    """A clothed adult of the given proportions."""
    s = p.height / STANDARD.height
    lofts = {"torso": _torso(p, s), "head": _head(p, s)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, rings, look, length, standard in (
            ("upper_arm", UPPER_ARM, "shirt", p.upper_arm, STANDARD.upper_arm),
            ("forearm", FOREARM, "skin", p.forearm, STANDARD.forearm),
            ("thigh", THIGH, "trousers", p.thigh, STANDARD.thigh),
            ("shin", SHIN, "trousers", p.shin, STANDARD.shin),
            ("foot", FOOT, "shoes", p.foot, STANDARD.foot),
        ):
            limb = loft(part, look, rings, length=length / standard, width=s)
            lofts[f"{side}_{part}"] = (limb,)
        lofts[f"{side}_hand"] = _hand(p, s, sign)
    return PersonBody(name, tuple(BodyPart(part, lofts[part]) for part, *_ in PARTS))


def hand_body(name: str, p: Proportions) -> PersonBody:
    """A lone forearm and hand; the parts are those of a person's right arm."""
    whole = person_body(name, p)
    parts = [q for q in whole.parts if q.name in ("right_forearm", "right_hand")]
    return PersonBody(name, tuple(parts))


UPPER_ARM = (
    (-0.045, 0.020),
    (-0.035, 0.038),
    (-0.010, 0.056),
    (0.040, 0.058),
    (0.120, 0.053),
    (0.220, 0.047),
    (0.310, 0.044),
    (0.345, 0.036),
    (0.355, 0.020),
)
FOREARM = (
    (-0.035, 0.018),
    (-0.020, 0.036),
    (0.010, 0.042),
    (0.060, 0.043),
    (0.130, 0.037),
    (0.200, 0.029, 0.031),
    (0.250, 0.023, 0.029),
    (0.265, 0.014, 0.020),
)
THIGH = (
    (-0.060, 0.045),
    (-0.040, 0.070),
    (0.000, 0.086, 0.084),
    (0.080, 0.086, 0.083),
    (0.220, 0.073),
    (0.360, 0.061, 0.059),
    (0.430, 0.058, 0.056),
    (0.460, 0.045),
    (0.470, 0.020),
)
SHIN = (
    (-0.040, 0.025),
    (-0.025, 0.046),
    (0.010, 0.056, 0.055),
    (0.090, 0.060, 0.056, -0.008),
    (0.180, 0.056, 0.052, -0.008),
    (0.300, 0.050),
    (0.400, 0.050, 0.048),
    (0.432, 0.050, 0.046),
    (0.438, 0.030),
)
FOOT = (  # x points down here
    (-0.062, 0.018, 0.014, 0.040),
    (-0.055, 0.028, 0.026, 0.036),
    (-0.030, 0.040, 0.034, 0.026),
    (0.010, 0.043, 0.036, 0.020),
    (0.070, 0.032, 0.041, 0.021),
    (0.130, 0.022, 0.044, 0.016),
    (0.180, 0.018, 0.041, 0.012),
    (0.205, 0.013, 0.030, 0.013),
    (0.215, 0.006, 0.014, 0.014),
)
HIPS = (
    (-0.150, 0.040, 0.060),
    (-0.130, 0.080, 0.120),
    (-0.080, 0.108, 0.158, -0.006),
    (-0.020, 0.117, 0.170, -0.010),
    (0.040, 0.108, 0.162, -0.004),
    (0.090, 0.101, 0.152),
    (0.100, 0.080, 0.120),
)
SHIRT = (
    (0.070, 0.080, 0.130),
    (0.075, 0.107, 0.160),
    (0.160, 0.103, 0.150),
    (0.250, 0.108, 0.156, 0.004),
    (0.340, 0.120, 0.172, 0.008),
    (0.410, 0.120, 0.186, 0.006),
    (0.455, 0.106, 0.188),
    (0.485, 0.088, 0.172, -0.006),
    (0.510, 0.070, 0.125, -0.010),
    (0.530, 0.058, 0.076, -0.008),
    (0.540, 0.040, 0.050, -0.008),
)
NECK = (
    (-0.050, 0.040),
    (-0.030, 0.058, 0.060, -0.008),
    (0.020, 0.056, 0.058, -0.002),
    (0.080, 0.054, 0.056, 0.006),
    (0.120, 0.040),
)
SKULL = (  # about the head's centre
    (-0.122, 0.022, 0.018, 0.050),
    (-0.114, 0.040, 0.034, 0.042),
    (-0.090, 0.062, 0.050, 0.026),
    (-0.055, 0.082, 0.061, 0.012),
    (-0.010, 0.093, 0.071, 0.003),
    (0.035, 0.096, 0.075, -0.002),
    (0.070, 0.088, 0.071, -0.006),
    (0.100, 0.066, 0.055, -0.010),
    (0.116, 0.036, 0.030, -0.012),
    (0.120, 0.012, 0.010, -0.012),
)
HAIR = (
    (-0.075, 0.020, 0.030, -0.070),
    (-0.065, 0.036, 0.056, -0.060),
    (-0.020, 0.056, 0.077, -0.048),
    (0.020, 0.070, 0.082, -0.036),
    (0.055, 0.088, 0.081, -0.018),
    (0.085, 0.088, 0.075, -0.012),
    (0.110, 0.070, 0.060, -0.013),
    (0.127, 0.040, 0.034, -0.014),
    (0.132, 0.014, 0.012, -0.014),
)
PALM = (  # x is the back of the hand, y across it
    (-0.012, 0.012, 0.018),
    (-0.004, 0.021, 0.028),
    (0.030, 0.019, 0.037),
    (0.065, 0.016, 0.042),
    (0.088, 0.013, 0.042),
    (0.096, 0.007, 0.034),
)


def _torso(p: Proportions, s: float) -> tuple[Loft, ...]:
    long, wide = p.trunk / STANDARD.trunk, p.shoulder_half / STANDARD.shoulder_half
    across = 0.5 * (s + wide)
    return (
        loft("hips", "trousers", HIPS, length=long, width=s, segments=24),
        loft("shirt", "shirt", SHIRT, length=long, width=across, pieces=4, segments=24),
    )


def _head(p: Proportions, s: float) -> tuple[Loft, ...]:
    h = p.neck_to_head
    eyes = tuple(
        loft(
            f"eye_{i}",
            "eyes",
            ((-0.008, 0.003), (-0.004, 0.008), (0.004, 0.008), (0.008, 0.003)),
            width=s,
            pieces=0,
            origin=(0.087 * s, y * s, h + 0.012 * s),
            segments=8,
        )
        for i, y in enumerate((-0.031, 0.031))
    )
    nose = ((-0.030, 0.006), (-0.024, 0.015, 0.015), (0.0, 0.010), (0.022, 0.005, 0.005, -0.004))
    return (
        loft("neck", "skin", NECK, length=h / STANDARD.neck_to_head, width=s),
        loft("skull", "skin", SKULL, length=s, width=s, origin=(0, 0, h), segments=20),
        loft("hair", "hair", HAIR, length=s, width=s, origin=(0, 0, h), segments=20),
        loft("nose", "skin", nose, width=s, pieces=0, origin=(0.094 * s, 0, h), segments=8),
        *eyes,
    )


def _hand(p: Proportions, s: float, sign: float) -> tuple[Loft, ...]:
    h = p.hand / STANDARD.hand
    palm = loft("palm", "skin", PALM, length=h, width=s)
    fingers = tuple(
        _finger(f"finger_{i}", length * s, 0.0095 * s, (-0.001 * s, y * s, 0.086 * h), y * 0.9)
        for i, (y, length) in enumerate(
            ((0.030, 0.066), (0.010, 0.079), (-0.010, 0.074), (-0.029, 0.057))
        )
    )
    thumb = _finger(
        "thumb", 0.066 * s, 0.0125 * s, (-0.004 * s, -sign * 0.024 * s, 0.012 * h), -sign * 0.75
    )
    return (palm, *fingers, thumb)


def _finger(
    name: str, length: float, radius: float, origin: tuple[float, float, float], spread: float
) -> Loft:
    """A finger from its knuckle, turned by ``spread`` [rad] about the back of the hand's axis."""
    c, n = np.cos(spread), np.sin(spread)
    curl = 0.25  # relaxed fingers bend towards the palm
    a, b = np.cos(curl), np.sin(curl)
    sideways: Floats = np.array([[1.0, 0.0, 0.0], [0.0, c, n], [0.0, -n, c]])
    inward: Floats = np.array([[a, 0.0, -b], [0.0, 1.0, 0.0], [b, 0.0, a]])
    r = radius
    rings = (
        (-0.6 * r, 0.6 * r),
        (0.0, r),
        (0.5 * length, 0.95 * r),
        (length - 0.5 * r, 0.85 * r),
        (length, 0.45 * r),
    )
    return loft(name, "skin", rings, origin=origin, turn=sideways @ inward, segments=8)
