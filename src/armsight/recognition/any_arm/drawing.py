"""Draws arms over their picture."""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats
from armsight.recognition.any_arm.sighting import Arm, Sighting

_TINTS = ((255, 170, 0), (0, 190, 255), (160, 110, 255), (90, 220, 90))
_BONE, _JOINT, _BASE, _PAPER = (255, 255, 255), (230, 40, 40), (200, 0, 200), (20, 20, 20)
_DOUBT = (150, 150, 150)
SURE = 0.5


def draw(image: ColorImage, found: Sighting) -> ColorImage:
    """(h, w, 3) copy with each arm's mask, skeleton, type and how sure it is.

    Joints are red and the base is magenta; a skeleton that is not believed is grey.
    """
    out = np.ascontiguousarray(image).copy()
    thick = max(1, round(max(out.shape[:2]) / 400))
    for k, arm in enumerate(found.arms):
        tint = _TINTS[k % len(_TINTS)]
        seen = (arm.mask >= SURE).astype(np.uint8)
        out = np.where(seen[..., None] > 0, (0.65 * out + 0.35 * np.array(tint)), out)
        out = out.astype(np.uint8)
        outline, _ = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(out, outline, -1, tint, thick)
    for arm in found.arms:
        if arm.T_camera_base is not None:
            _skeleton(out, found.pixels(arm), arm.believed, thick)
    _words(out, [*(_title(arm) for arm in found.arms), *found.notes], thick)
    return out


def mask_of(found: Sighting, shape: tuple[int, ...]) -> Bytes:
    """(h, w) 255 where any arm certainly is, less where it is less sure."""
    both = np.zeros(shape[:2], np.float32)
    for arm in found.arms:
        both = np.maximum(both, arm.mask)
    return np.asarray(np.round(255.0 * np.clip(both, 0, 1)), np.uint8)


def _title(arm: Arm) -> str:
    words = f"{arm.robot} {100 * arm.types.get(arm.robot, 0.0):.0f} %"
    if arm.T_camera_base is not None:
        words += f", base {float(np.linalg.norm(arm.base)):.2f} m away"
    return f"{words}; {arm.problem}" if arm.problem else f"{words}; trust {100 * arm.trust:.0f} %"


def _skeleton(out: ColorImage, pixels: Floats, believed: bool, thick: int) -> None:
    limit = 4 * max(out.shape[:2])
    good = np.isfinite(pixels).all(axis=1) & (np.abs(np.nan_to_num(pixels)) < limit).all(axis=1)
    places = [tuple(int(v) for v in np.round(p)) if g else None for p, g in zip(pixels, good)]
    for first, second in itertools.pairwise(places):
        if first and second:
            cv2.line(out, first, second, _PAPER, 3 * thick, cv2.LINE_AA)
            cv2.line(out, first, second, _BONE if believed else _DOUBT, thick, cv2.LINE_AA)
    for k, place in enumerate(places):
        if place:
            tint = _BASE if k == 0 else _JOINT
            cv2.circle(out, place, 3 * thick, tint if believed else _DOUBT, -1, cv2.LINE_AA)


def _words(out: ColorImage, lines: list[str], thick: int) -> None:
    scale = max(0.35, out.shape[1] / 1700)
    step = round(32 * scale) + 2
    for k, line in enumerate(lines):
        for tint, width in ((_PAPER, 3 * thick), (_BONE, thick)):
            place = (6, (k + 1) * step)
            cv2.putText(out, line, place, cv2.FONT_HERSHEY_SIMPLEX, scale, tint, width, cv2.LINE_AA)
