"""Whether what a network sees in a crop is an arm at all."""

from __future__ import annotations

from armsight.arrays import Floats32
from armsight.recognition.any_arm.model import Look

ARM = 0.5
"""Probability from which a cell is the arm's."""
CLEAR = 0.7
"""Mean probability of these cells below which there is no arm: of 95 held-back crops of empty rooms
86 were said to be empty without it and 92 are with it, of 122 with an arm four and six."""
FOUND = (1.0 / 3.0, 0.5, 0.5)
"""Mean probability of some robot's landmarks' peaks that an arm must have, by the look at the whole
picture that shows it. Chosen on pictures of both renderers."""
TOGETHER, SOME, LARGE = 1.75, 0.15, 40.0
"""Sum of the two and of the probability of the known types from which there may be an arm as well;
mean probability of the landmarks' peaks that it must have then, since a disc has no joints; and
cells that the lump must have, since lamps and handles are small. Of 240 arms on tuning
pictures of both renderers six are found by it alone, and four of 110 empty rooms are lost."""
SURE = 1.5
"""Sureness of a look from which nobody looks again."""
STAYS = (1.05, 1.15, 1.25)
"""Mean sureness of a look and of three more that an arm has, by the look at the whole picture that
shows it: where the whole had to be made large to show anything, it mostly is none. Chosen on tuning
pictures of both renderers: of 320 empty ones 314 are said to be empty, 301 without, and of 406 arms
three are lost."""
EXPLAINED = 0.8
"""Overlap with the mask of a fitted arm that stays one however doubtful it looks."""
SPECK, SUPPORTED = 0.005, 0.05
"""What covers less than this share of a picture, and whose answer has less trust, is no arm. Chosen
on tuning pictures of both renderers: of twelve arms seen in 310 empty ones four are such, of 153
true ones none."""


def is_arm(look: Look, least: float = 0.0) -> bool:
    """Whether a crop surely shows an arm.

    Args:
        look: at the crop.
        least: mean probability of some robot's landmarks that an arm has.
    """
    return clearness(look) >= CLEAR and landmarks_found(look) >= least


def may_be_arm(look: Look, strength: float) -> bool:
    """Whether it is one if the picture shows no other.

    Something large is of one of the known types so surely that cells or landmarks may be doubtful.
    What looks like an arm in an empty room is mostly small, or called unknown.

    Args:
        look: at the crop.
        strength: of the lump in the whole picture that the crop is of [cells].
    """
    clear, found = clearness(look), landmarks_found(look)
    if clear == 0.0 or found < SOME or strength < LARGE:
        return False
    return clear + found + 1.0 - look.types["none"] - look.types["unknown"] >= TOGETHER


def is_speck(mask: Floats32, trust: float) -> bool:
    """Whether what was taken for an arm is too small to tell, and nothing speaks for it."""
    return trust < SUPPORTED and float((mask >= 0.5).mean()) < SPECK


def sureness(look: Look) -> float:
    """How surely cells, landmarks and type say that there is an arm, -1..2."""
    return _mean_cell(look) + landmarks_found(look) - look.types["none"]


def clearness(look: Look) -> float:
    """Mean probability of the arm's cells; 0 where there are none or it is said to be empty."""
    return 0.0 if look.empty else _mean_cell(look)


def _mean_cell(look: Look) -> float:
    """Mean probability of the arm's cells; 0 where there are none."""
    seen = look.arm > ARM
    return float(look.arm[seen].mean()) if seen.any() else 0.0


def landmarks_found(look: Look) -> float:
    """How surely the landmarks of any robot are seen, 0..1."""
    return max(float(places.mass.mean()) for places in look.places.values())
