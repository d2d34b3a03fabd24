"""Edges of a picture at several sizes: what seeds, rings and templates are looked up in."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from armsight.arrays import Bytes, SignedBytes, SignedShorts
from armsight.charging.kernels.votes import edge_field
from armsight.charging.looks import noise_of
from armsight.geometry.camera import PinholeCamera

LEVELS = 5
"""Full size and four halvings."""
COUNTS = 64
"""Counts of a gradient of one level a pixel."""
LARGER = 2
"""How many times larger than taken a small port is looked at."""
LARGER_NOISE = 3.1
"""Noise of gradients there, against that of the picture as it was taken (white noise, computed)."""
NOISIER = 3.0
"""Most that noise at a place may be taken to exceed that of all of the picture: the rest of what is
seen there is edges."""
CELL = 32
"""What is looked at larger begins at multiples of this [px]."""
STABLE = np.round(16 * 20.0 * np.sqrt(np.arange(256) + 4.0)).astype(np.int16)
"""Grey levels stretched so that noise is about as large in the dark, where black plastic is, as in
the light (shot noise grows with the root of the light); a level counts 16 at 100."""


@dataclass(frozen=True, eq=False)
class Level:
    """One size of a picture.

    Attributes:
        scale: of this size against the whole: 1, 1/2, 1/4 ...
        gx, gy: (h, w) gradients, :data:`COUNTS` to a level a pixel.
        noise: standard deviation of gradients where there is nothing to see [counts].
        field: (h, w, 2) of :func:`armsight.charging.kernels.votes.edge_field`.
        soft: (h, w) the grey levels that they were taken from.
        parts: of it that were made larger, by their corner and side: guesses at one place share
            one.
        quiet: noise about places, by their cell and side.
    """

    scale: float
    gx: SignedShorts
    gy: SignedShorts
    noise: float
    field: SignedBytes
    soft: SignedShorts
    parts: dict[tuple[int, int, int], Part] = dataclasses.field(default_factory=dict)
    quiet: dict[tuple[int, int, int], float] = dataclasses.field(default_factory=dict)

    @property
    def least(self) -> float:
        """Gradients below this say nothing [counts]."""
        return _least(self.noise)


@dataclass(frozen=True, eq=False)
class Part:
    """Gradients of a window of a picture that was made larger; see :class:`Level`."""

    gx: SignedShorts
    gy: SignedShorts
    left: int
    top: int
    noise: float


@dataclass(frozen=True, eq=False)
class Edges:
    """Where edges are searched: gradients, what of them says nothing, the lens that sees them.

    Attributes:
        gx, gy, noise, scale: see :class:`Level`.
        local: noise about the place [counts].
        lens: that took a picture of this size and place.
    """

    gx: SignedShorts
    gy: SignedShorts
    noise: float
    local: float
    scale: float
    lens: PinholeCamera

    @property
    def least(self) -> float:
        """See :class:`Level`."""
        return _least(self.noise)


def pyramid(image: Bytes, levels: int = LEVELS) -> tuple[Level, ...]:
    """All sizes of a grey picture, the finest first."""
    out = []
    # whole numbers of two bytes: what takes time here is memory
    soft = np.asarray(cv2.LUT(image, STABLE), np.int16)
    for i in range(levels):
        if i:
            soft = np.asarray(cv2.pyrDown(soft), np.int16)
        if min(soft.shape) < 20:
            break
        # a wider Sobel where nothing has smoothed the picture yet
        size, scale = (5, 1 / 128) if i == 0 else (3, 1 / 8)
        scale *= COUNTS / 16
        gx = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 1, 0, ksize=size, scale=scale), np.int16)
        gy = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 0, 1, ksize=size, scale=scale), np.int16)
        noise = noise_of(gx, gy)
        out.append(Level(0.5**i, gx, gy, noise, edge_field(gx, gy, 0.7 * _least(noise)), soft))
    return tuple(out)


def edges_of(
    levels: Sequence[Level], lens: PinholeCamera, i: int, u: float, v: float, reach: float
) -> Edges:
    """A size of a picture to search edges in; below 0: made larger about a place.

    A port whose mouth has a radius of 15 px has edges 3 px apart: in the picture as it was taken
    a Sobel takes two of them for one, at neither's place.

    Args:
        levels: of the picture.
        lens: that took it.
        i: which size.
        u: the place [px].
        v: the place [px].
        reach: half the side of what has to be seen [px].
    """
    if i >= 0:
        level = levels[i]
        local = _noise_about(level, u * level.scale, v * level.scale, reach * level.scale)
        return Edges(level.gx, level.gy, level.noise, local, level.scale, lens.scaled(level.scale))
    whole = levels[0]
    h, w = whole.soft.shape
    side = CELL * (int(2 * reach) // CELL + 2)
    left, top = (int(at - 0.5 * (side - CELL)) // CELL * CELL for at in (u, v))
    key = (min(max(left, 0), w - CELL), min(max(top, 0), h - CELL), side)
    if key not in whole.parts:
        whole.parts[key] = _larger(whole.soft, *key)
    part = whole.parts[key]
    own = replace(lens, cx=lens.cx - part.left, cy=lens.cy - part.top).scaled(LARGER)
    noise = LARGER_NOISE * whole.noise
    local = min(max(part.noise, noise), NOISIER * noise)
    return Edges(part.gx, part.gy, noise, local, LARGER, own)


def _larger(soft: SignedShorts, left: int, top: int, side: int) -> Part:
    window = soft[top : top + side, left : left + side]
    large = cv2.resize(window, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_CUBIC)
    scale = LARGER * COUNTS / 16 / 128
    gx = np.asarray(cv2.Sobel(large, cv2.CV_16S, 1, 0, ksize=5, scale=scale), np.int16)
    gy = np.asarray(cv2.Sobel(large, cv2.CV_16S, 0, 1, ksize=5, scale=scale), np.int16)
    return Part(gx, gy, left, top, noise_of(gx, gy))


def _noise_about(level: Level, u: float, v: float, reach: float) -> float:
    """Noise about a place [counts]: in the dark there may be more of it than elsewhere."""
    side = CELL * (int(2 * reach) // CELL + 2)
    left, top = (max(int(at - 0.5 * (side - CELL)) // CELL * CELL, 0) for at in (u, v))
    if (left, top, side) not in level.quiet:
        rows, columns = slice(top, top + side), slice(left, left + side)
        gx, gy = level.gx[rows, columns], level.gy[rows, columns]
        noise = noise_of(gx, gy) if min(gx.shape) > 8 else 0.0
        level.quiet[left, top, side] = min(max(noise, level.noise), NOISIER * level.noise)
    return level.quiet[left, top, side]


def _least(noise: float) -> float:
    return max(3.0 * noise, 0.5 * COUNTS)
