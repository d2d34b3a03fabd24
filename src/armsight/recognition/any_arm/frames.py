"""Stage one: where in a whole picture arms are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32
from armsight.recognition.any_arm.evidence import STRIDE
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.views import WHOLE, Whole, take_whole

SURE, LEAST = 0.5, 0.3
"""Probabilities of an arm: of a lump's best cells, and of those that belong to it."""
CELLS = 4.0
"""Sum of the probabilities that a lump has at least [cells]."""
APART = 2
"""Cells between two lumps that are one: something stands before an arm."""
LOOKS = (WHOLE, 384, 512)
"""Longer sides that a picture is looked at with, until an arm is found [px]."""
MOST = 4
"""Arms that are looked at."""


@dataclass(frozen=True)
class Lump:
    """A part of a picture that looks like an arm.

    Attributes:
        low, high: (2,) corners of its box [px of the picture].
        strength: sum of its probabilities [cells].
    """

    low: Floats
    high: Floats
    strength: float


def find_lumps(
    model: CropModel, image: ColorImage, longest: int = WHOLE
) -> tuple[list[Lump], Floats32]:
    """Lumps of a picture, the strongest first; and the (rows, columns) map that they are of.

    Args:
        model: the network.
        image: the picture.
        longest: its longer side as the network gets it [px].
    """
    whole = take_whole(image, longest)
    rows, columns = (-(-n // STRIDE) for n in whole.inside)
    arm = model.arm(whole.image)[:rows, :columns]
    return lumps_of(arm, whole), arm


def lumps_of(arm: Floats32, whole: Whole) -> list[Lump]:
    """Connected parts of a map of probabilities, the strongest first."""
    above = (arm >= LEAST).astype(np.uint8)
    side = 2 * APART + 1
    joined = cv2.morphologyEx(above, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    count, labels = cv2.connectedComponents(joined)
    found = []
    for k in range(1, count):
        mine = (labels == k) & (above > 0)
        weight = float(arm[mine].sum())
        if weight < CELLS or float(arm[mine].max()) < SURE:
            continue
        row, column = np.nonzero(mine)
        low = np.array([column.min(), row.min()]) * STRIDE / whole.scale
        high = np.array([column.max() + 1, row.max() + 1]) * STRIDE / whole.scale
        found.append(Lump(low, high, weight))
    return sorted(found, key=lambda lump: -lump.strength)[:MOST]
