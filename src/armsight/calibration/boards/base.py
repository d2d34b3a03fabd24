"""What every kind of calibration board can do.

Board frame: z = 0 on the print, x to the right and y down as it is read, z into the paper, so that
a board seen straight on has the camera's axes. Pixel centres count from 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Points
from armsight.calibration.corners import straightness

LARGEST = 200
"""Squares, tags or circles in a row, at most: more is a slip of the keyboard."""


@dataclass(frozen=True)
class Tile:
    """A rectangle of the print; later tiles cover earlier.

    Attributes:
        x0, y0, x1, y1: in the board's frame [m].
        dark: printed or left white.
        round: the ellipse within instead of the rectangle.
    """

    x0: float
    y0: float
    x1: float
    y1: float
    dark: bool
    round: bool = False


@dataclass(frozen=True)
class Detection:
    """A board found in an image.

    Attributes:
        corner: (m,) indices of the corners; pixel: (m, 2) where [px].
        spread: rms distance of the corners from a flat board's perspective [px]; lens distortion
            included, so a few tenths are normal.
    """

    corner: Ints
    pixel: Floats
    spread: float


@dataclass(frozen=True)
class Miss:
    """No usable board in an image, and why."""

    reason: str


@dataclass(frozen=True)
class Turn:
    """A way to read a board that looks alike when it is turned.

    Attributes:
        angle: of the turn about its normal [rad].
        corner: (k,) which corner each is then taken for.
    """

    angle: float
    corner: Ints


class Board(Protocol):
    """What every kind of board can do."""

    @property
    def points(self) -> Points:
        """(k, 3) corners in the board's frame [m]."""
        ...

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the print without its white margin [m]."""
        ...

    @property
    def turns(self) -> tuple[Turn, ...]:
        """Other ways in which an image can be read; empty where the print tells its order."""
        ...

    def tiles(self) -> list[Tile]:
        """The print as rectangles on white."""
        ...

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the board in an (h, w) uint8 image."""
        ...

    def describe(self) -> str:
        """One line for people."""
        ...


def grid_points(columns: int, rows: int, spacing: float) -> Points:
    """(columns * rows, 3) points of a grid, row by row [m]."""
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1) * spacing


def grid_turns(columns: int, rows: int, quarter: bool) -> tuple[Turn, ...]:
    """Turns of a full grid by a half, and by quarters where it is as wide as high."""
    index = np.arange(columns * rows).reshape(rows, columns)
    out = [Turn(np.pi, index[::-1, ::-1].ravel())]
    if quarter and columns == rows:
        out.append(Turn(np.pi / 2, np.rot90(index).ravel()))
        out.append(Turn(-np.pi / 2, np.rot90(index, -1).ravel()))
    return tuple(out)


def whole(points: Points, corner: Ints, pixel: Floats) -> Detection | Miss:
    """A detection of a full grid, if it is flat."""
    spread = straightness(np.asarray(points[corner, :2], np.float64), pixel)
    spacing = float(np.linalg.norm(pixel[2] - pixel[1]))
    if spread > max(1.0, 0.08 * spacing):
        return Miss(f"corners do not lie on a flat board ({spread:.1f} px)")
    return Detection(corner, pixel, spread)


def partial(points: Points, corner: Ints, pixel: Floats, square: float) -> Detection | Miss:
    """A detection of some corners, if they are enough and flat."""
    order = np.argsort(corner)
    corner, pixel = corner[order], pixel[order]
    flat = points[corner, :2] - points[corner, :2].mean(0)
    if len(corner) < 4 or np.linalg.svd(flat, compute_uv=False)[1] < 0.5 * square:
        return Miss(f"only {len(corner)} corners, all in one row")
    spread = straightness(np.asarray(points[corner, :2], np.float64), pixel)
    if spread > 3.0:
        return Miss(f"corners do not lie on a flat board ({spread:.1f} px)")
    return Detection(corner, pixel, spread)
