"""What every overlay draws: an arm's skeleton, and words."""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats

_BONE, _JOINT, _BASE, _PAPER = (255, 255, 255), (230, 40, 40), (200, 0, 200), (20, 20, 20)
_DOUBT = (150, 150, 150)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def thickness(image: ColorImage) -> int:
    """Of lines [px]."""
    return max(1, round(max(image.shape[:2]) / 400))


def draw_skeleton(out: ColorImage, pixels: Floats, believed: bool = True) -> None:
    """Draw (k, 2) pixels of joints, base first, and the bones between, into a picture.

    Joints are red and the base is magenta; a skeleton that is not believed is grey. Pixels that are
    not finite, or far beside the picture, are left out.
    """
    thick = thickness(out)
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


def draw_words(out: ColorImage, lines: list[str], width: float) -> None:
    """Write lines into a picture's upper left corner, at full size in one of this width [px].

    What is wider than the picture goes on in the next line.
    """
    thick = thickness(out)
    scale = max(0.35, out.shape[1] / width)
    step = round(32 * scale) + 2
    rows = [row for line in lines for row in _broken(line, out.shape[1] - 12, scale, thick)]
    for k, row in enumerate(rows):
        place = (6, (k + 1) * step)
        for tint, line_width in ((_PAPER, 3 * thick), (_BONE, thick)):
            cv2.putText(out, row, place, _FONT, scale, tint, line_width, cv2.LINE_AA)


def _broken(line: str, width: float, scale: float, thick: int) -> list[str]:
    """A line as rows of at most this width [px], broken between words."""
    rows: list[str] = []
    for word in line.split():
        longer = f"{rows[-1]} {word}" if rows else word
        if rows and cv2.getTextSize(longer, _FONT, scale, thick)[0][0] <= width:
            rows[-1] = longer
        else:
            rows.append(word)
    return rows
