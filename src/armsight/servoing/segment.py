"""Regions of a colour in a picture: V's thresholds in Lab and morphology; sub-pixel outlines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Floats32
from armsight.servoing.color_kernels import chroma_along, pick_color
from armsight.servoing.kernels import last_steps_down

SPOKES = 72
"""Rays from a region's middle along which its outline is looked for."""
STEP_DOWN = 8.0
"""An outline is a step of the chroma of at least this."""
ROUNDED = 3.0
"""Lab of 8 bits is off by less than this [1]; what it can rule out is not looked at again."""


@dataclass(frozen=True)
class LabColor:
    """A colour by its hue and least chroma in CIE Lab, whatever the light.

    Attributes:
        hue_deg: angle of (a*, b*) [deg]; width_deg: how far it may be off.
        chroma: least length of (a*, b*); purity: least share of it in L*, which shade leaves be.
        lightness: least and greatest L*.
    """

    hue_deg: float
    width_deg: float
    chroma: float = 12.0
    purity: float = 1.0
    lightness: tuple[float, float] = (2.0, 97.0)


@dataclass(frozen=True)
class Region:
    """A connected region of a colour.

    Attributes:
        mask: (h, w) of its window, 255 inside; corner: (u, v) of the window in the picture [px].
        center: (2,) centre of mass [px]; area: [px].
    """

    mask: Bytes
    corner: tuple[int, int]
    center: Floats
    area: float

    @cached_property
    def hull(self) -> float:
        """Area of its convex hull [px], 1 or more."""
        contours, _ = cv2.findContours(self.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return max(float(cv2.contourArea(cv2.convexHull(np.concatenate(contours)))), 1.0)


def lab_of(image: ColorImage) -> Floats32:
    """(h, w, 3) CIE L* (0..100), a*, b* of a picture."""
    light = np.divide(image, np.float32(255.0), dtype=np.float32)
    return np.asarray(cv2.cvtColor(light, cv2.COLOR_RGB2LAB), np.float32)


def saturation(image: ColorImage, color: LabColor) -> Floats32:
    """(h, w) chroma along a colour's hue: large on it, about 0 on grey, negative opposite to it."""
    out = np.empty(image.shape[:2], np.float32)
    chroma_along(_compiled_for(image), _hue(color), out)
    return out


def color_mask(image: ColorImage, color: LabColor, opening: int = 3) -> Bytes:
    """(h, w) 255 where a picture has a colour, specks removed and small holes closed.

    Lab of 8 bits, which is cheap, says where the colour may be; the rest is done there alone.
    """
    image = _compiled_for(image)
    quick = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2LAB), np.uint8)
    mask = np.empty(image.shape[:2], np.uint8)
    pick_color(
        image, quick, _brightest(color), _hue(color), np.tan(np.deg2rad(color.width_deg)),
        color.chroma, color.purity, color.lightness, mask,
    )  # fmt: skip
    if opening > 1 and mask.any():
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (opening, opening))
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel), np.uint8)
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel), np.uint8)
    return mask


def _compiled_for(image: ColorImage) -> ColorImage:
    """As the loops were compiled for: for a turned or read-only one they would be anew."""
    return np.require(image, np.uint8, ["C", "W"])


@lru_cache(maxsize=16)
def _hue(color: LabColor) -> Floats:
    """(2,) its cosine and sine."""
    hue = np.deg2rad(color.hue_deg)
    return np.array([np.cos(hue), np.sin(hue)])


@lru_cache(maxsize=16)
def _brightest(color: LabColor) -> Bytes:
    """(256, 256) 8-bit lightness by a and b of 8 bits below which a pixel may have a colour."""
    c, s = _hue(color)
    a, b = np.mgrid[:256, :256] - 128.0
    slack = ROUNDED * (abs(c) + abs(s))
    along = a * c + b * s + slack
    across = np.maximum(np.abs(b * c - a * s) - slack, 0.0)
    may = (along > color.chroma) & (across < along * np.tan(np.deg2rad(color.width_deg)))
    lightness = color.lightness[1] if color.purity <= 0.0 else along / color.purity
    most = np.minimum(lightness, color.lightness[1]) + ROUNDED
    return np.asarray(np.where(may, np.clip(most * 2.55, 0.0, 255.0), 0.0), np.uint8)


def regions(mask: Bytes, least: float, most: int = 6, gap: int = 0) -> list[Region]:
    """Connected regions of at least so many pixels, the largest first, at most so many.

    Args:
        mask: (h, w), not zero inside.
        least: pixels of a region.
        most: how many.
        gap: what is no farther apart than this is one region [px].
    """
    if gap > 0:
        return _groups(mask, least, most, gap)
    left, top, columns, rows = cv2.boundingRect(mask)
    if columns == 0:
        return []
    part = mask[top : top + rows, left : left + columns]
    count, labels, stats, centers = cv2.connectedComponentsWithStats(part, connectivity=8)
    order = sorted(range(1, count), key=lambda i: -stats[i, cv2.CC_STAT_AREA])
    found = []
    for i in order[:most]:
        u, v, w, h, area = (int(x) for x in stats[i])
        if area < least:
            break
        window = (labels[v : v + h, u : u + w] == i).astype(np.uint8) * 255
        center = centers[i] + np.array([left, top], float)
        found.append(Region(window, (u + left, v + top), center, float(area)))
    return found


def _groups(mask: Bytes, least: float, most: int, gap: int) -> list[Region]:
    """As :func:`regions`, of pieces that lie near each other together."""
    width = gap + 1 + gap % 2
    around = cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width)))
    found = []
    for group in regions(np.asarray(around, np.uint8), least, 2 * most):
        (u, v), (h, w) = group.corner, group.mask.shape
        inside = np.asarray(mask[v : v + h, u : u + w] & group.mask, np.uint8)
        area = float(np.count_nonzero(inside))
        if area >= least:
            center = np.argwhere(inside)[:, ::-1].mean(axis=0) + np.array([u, v], float)
            found.append(Region(inside, (u, v), center, area))
    return sorted(found, key=lambda region: -region.area)[:most]


def outline(signal: Floats32, region: Region) -> Floats:
    """(k, 2) sub-pixel points of a region's outline [px], where the signal falls to half.

    Along rays from the region's middle the last step down is looked for; its level is the mean of
    what lies just inside and just outside, so that shading does not move it. Rays that leave the
    picture, or find no clear step, give no point.
    """
    reach = float(np.hypot(*region.mask.shape)) * 0.6 + 4.0
    step, ways = 0.5, _ways()
    off = 5 if np.sqrt(region.area) > 14.0 else 3  # steps from the border to both levels
    crossing = np.empty(SPOKES)
    last_steps_down(
        signal, region.mask, np.array(region.corner, float), region.center, ways, step,
        int(np.ceil(reach / step)) - 1, off, STEP_DOWN, crossing,
    )  # fmt: skip
    clear = crossing >= 0.0
    along = step * (crossing[clear] + 1.0)
    return np.asarray(region.center + ways[clear] * along[:, None], float)


@lru_cache(maxsize=1)
def _ways() -> Floats:
    """(m, 2) unit vectors all around."""
    angle = np.linspace(0.0, 2.0 * np.pi, SPOKES, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
