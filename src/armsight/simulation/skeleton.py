"""A person as points: which joints there are, how far apart, and the body parts between them.

A pose of a person is a (19, 3) array of joint positions in world [m], in the order of ``JOINTS``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, Ints, Points

JOINTS = (
    "pelvis",
    "neck",
    "head",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "left_hand",
    "right_shoulder",
    "right_elbow",
    "right_wrist",
    "right_hand",
    "left_hip",
    "left_knee",
    "left_ankle",
    "left_toe",
    "right_hip",
    "right_knee",
    "right_ankle",
    "right_toe",
)
"""The hand is the middle of the palm's far edge (the knuckles)."""
INDEX = {name: i for i, name in enumerate(JOINTS)}
MIRRORED: Ints = np.array(
    [
        INDEX[name.replace("left", "?").replace("right", "left").replace("?", "right")]
        for name in JOINTS
    ]
)
"""Left and right exchanged."""

LATERAL, FLAT = 0, 1
"""How a part turns about its axis: its y to the person's left, or its x upward (hands)."""

PARTS: tuple[tuple[str, str, str, int], ...] = (
    ("torso", "pelvis", "neck", LATERAL),
    ("head", "neck", "head", LATERAL),
    *(
        (f"{side}_{part}", f"{side}_{start}", f"{side}_{end}", turn)
        for side in ("left", "right")
        for part, start, end, turn in (
            ("upper_arm", "shoulder", "elbow", LATERAL),
            ("forearm", "elbow", "wrist", LATERAL),
            ("hand", "wrist", "hand", FLAT),
            ("thigh", "hip", "knee", LATERAL),
            ("shin", "knee", "ankle", LATERAL),
            ("foot", "ankle", "toe", LATERAL),
        )
    ),
)
"""Body parts: name, joint at the origin, joint on the z axis, turn."""
PART_START: Ints = np.array([INDEX[start] for _, start, _, _ in PARTS])
PART_END: Ints = np.array([INDEX[end] for _, _, end, _ in PARTS])
PART_TURN: Ints = np.array([turn for _, _, _, turn in PARTS])


@dataclass(frozen=True)
class Proportions:
    """Lengths between joints [m].

    What is not given follows from the height: limb shares after Drillis and Contini (1966), as
    printed in Winter, *Biomechanics and Motor Control of Human Movement*, fig. 4.1; the trunk's
    are rounded so that the parts add up to the height.
    """

    height: float = 1.75
    trunk: float = field(default=0.0)
    neck_to_head: float = field(default=0.0)
    shoulder_half: float = field(default=0.0)
    upper_arm: float = field(default=0.0)
    forearm: float = field(default=0.0)
    hand: float = field(default=0.0)
    hip_half: float = field(default=0.0)
    thigh: float = field(default=0.0)
    shin: float = field(default=0.0)
    ankle: float = field(default=0.0)
    foot: float = field(default=0.0)

    def __post_init__(self) -> None:
        """Fill what was not given from the height."""
        shares = {
            "trunk": 0.306,
            "neck_to_head": 0.102,
            "shoulder_half": 0.112,
            "upper_arm": 0.186,
            "forearm": 0.146,
            "hand": 0.050,
            "hip_half": 0.052,
            "thigh": 0.245,
            "shin": 0.246,
            "ankle": 0.039,
            "foot": 0.105,
        }
        for name, share in shares.items():
            if getattr(self, name) == 0.0:
                object.__setattr__(self, name, share * self.height)


def standing(p: Proportions) -> Points:
    """(19, 3) someone upright at the origin who looks along x, arms hanging, left along y."""
    hip = p.ankle + p.shin + p.thigh
    pose = np.zeros((len(JOINTS), 3))

    def put(name: str, x: float, y: float, z: float) -> None:
        pose[INDEX[name]] = (x, y, z)

    hip -= 0.017 * p.height  # nobody stands with knees locked
    put("pelvis", 0, 0, hip + 0.02)
    neck = hip + 0.02 + p.trunk
    put("neck", 0, 0, neck)
    put("head", 0.015, 0, neck + p.neck_to_head)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        y = sign * p.shoulder_half
        shoulder = neck - 0.023 * p.height
        put(f"{side}_shoulder", 0, y, shoulder)
        put(f"{side}_elbow", -0.02, y + sign * 0.05, shoulder - p.upper_arm)
        put(f"{side}_wrist", 0.05, y + sign * 0.06, shoulder - p.upper_arm - p.forearm)
        put(f"{side}_hand", 0.07, y + sign * 0.06, shoulder - p.upper_arm - p.forearm - p.hand)
        y = sign * p.hip_half
        put(f"{side}_hip", 0, y, hip)
        put(f"{side}_knee", 0.01, y, p.ankle + p.shin)
        put(f"{side}_ankle", -0.01, y * 1.1, p.ankle)
        put(f"{side}_toe", -0.01 + p.foot, y * 1.3, 0.035)
    return pose


def bend(start: Floats, end: Floats, first: float, second: float, toward: Floats) -> Points:
    """Middle joint and reached end of a two-bone limb.

    Args:
        start: (3,) or (k, 3) root joint [m].
        end: (3,) or (k, 3) wanted end [m]; one out of reach is pulled in.
        first: length of the bone at the root [m].
        second: length of the other bone [m].
        toward: (3,) or (k, 3) direction to which the middle joint points.

    Returns:
        (2, 3) or (2, k, 3): middle joint, end [m].
    """
    reach = end - start
    length = np.linalg.norm(reach, axis=-1, keepdims=True)
    axis = reach / np.maximum(length, 1e-9)
    length = _soft(np.maximum(length, abs(first - second) + 1e-3), first + second)
    along = (first**2 - second**2 + length**2) / (2.0 * length)
    aside = np.sqrt(np.maximum(first**2 - along**2, 0.0))
    side = toward - axis * np.sum(axis * toward, axis=-1, keepdims=True)
    side /= np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-9)
    return np.stack([start + axis * along + side * aside, start + axis * length])


def _soft(length: Floats, full: float) -> Floats:
    """Lengths up to ``full``, approached gently: a limb that snaps straight would jerk."""
    margin = 0.02 * full
    over = np.maximum(length - (full - margin), 0.0)
    gentle = 0.9999 * full - 0.995 * margin * np.exp(-over / margin)
    return np.asarray(np.where(over > 0.0, gentle, length))
