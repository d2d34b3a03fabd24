"""Draws what was recognised over its picture."""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats
from armsight.recognition.inference.recogniser import Recognition

_MASK, _BONE, _JOINT, _BASE, _PAPER = (
    (255, 170, 0),
    (255, 255, 255),
    (230, 40, 40),
    (200, 0, 200),
    (20, 20, 20),
)


def draw(image: ColorImage, found: Recognition) -> ColorImage:
    """(h, w, 3) copy with mask, skeleton, joints (red), base (magenta, as T5) and type.

    Args:
        image: the picture.
        found: what was recognised in it.
    """
    out = np.ascontiguousarray(image).copy()
    thick = max(1, round(max(out.shape[:2]) / 400))
    lines = [_title(found), *found.notes]
    if found.robot is not None:
        seen = (found.mask >= 0.5).astype(np.uint8)
        tint = (0.6 * out + 0.4 * np.array(_MASK)).astype(np.uint8)
        out = np.where(seen[..., None] > 0, tint, out)
        outline, _ = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(out, outline, -1, _MASK, thick)
        _skeleton(out, found.pixels(), thick)
    _words(out, lines, thick)
    return out


def _title(found: Recognition) -> str:
    if found.robot is None:
        return found.reason
    distance = float(np.linalg.norm(found.base))
    best = found.probabilities[found.robot]
    return f"{found.robot} {100 * best:.0f} %, base {distance:.2f} m away"


def _skeleton(out: ColorImage, pixels: Floats, thick: int) -> None:
    limit = 4 * max(out.shape[:2])
    good = np.isfinite(pixels).all(axis=1) & (np.abs(np.nan_to_num(pixels)) < limit).all(axis=1)
    places = [tuple(int(v) for v in np.round(p)) if g else None for p, g in zip(pixels, good)]
    for first, second in itertools.pairwise(places):
        if first and second:
            cv2.line(out, first, second, _PAPER, 3 * thick, cv2.LINE_AA)
            cv2.line(out, first, second, _BONE, thick, cv2.LINE_AA)
    for k, place in enumerate(places):
        if place:
            cv2.circle(out, place, 3 * thick, _BASE if k == 0 else _JOINT, -1, cv2.LINE_AA)


def _words(out: ColorImage, lines: list[str], thick: int) -> None:
    scale = max(0.35, out.shape[1] / 1500)
    step = round(32 * scale) + 2
    for k, line in enumerate(lines):
        place = (6, (k + 1) * step)
        for colour, width in ((_PAPER, 3 * thick), (_BONE, thick)):
            cv2.putText(
                out, line, place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width, cv2.LINE_AA
            )
