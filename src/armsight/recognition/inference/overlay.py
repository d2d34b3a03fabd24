"""Draws what was recognised over its picture."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import ColorImage
from armsight.recognition.drawing import draw_skeleton, draw_words, thickness
from armsight.recognition.inference.recogniser import Recognition

_MASK = (255, 170, 0)


def draw(image: ColorImage, found: Recognition) -> ColorImage:
    """(h, w, 3) copy with mask, skeleton, joints (red), base (magenta, as T5) and type.

    Args:
        image: the picture.
        found: what was recognised in it.
    """
    out = np.ascontiguousarray(image).copy()
    thick = thickness(out)
    lines = [_title(found), *found.notes]
    if found.robot is not None:
        seen = (found.mask >= 0.5).astype(np.uint8)
        tint = (0.6 * out + 0.4 * np.array(_MASK)).astype(np.uint8)
        out = np.where(seen[..., None] > 0, tint, out)
        outline, _ = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(out, outline, -1, _MASK, thick)
        draw_skeleton(out, found.pixels())
    draw_words(out, lines, 1500)
    return out


def _title(found: Recognition) -> str:
    if found.robot is None:
        return found.reason
    distance = float(np.linalg.norm(found.base))
    best = found.probabilities[found.robot]
    return f"{found.robot} {100 * best:.0f} %, base {distance:.2f} m away"
