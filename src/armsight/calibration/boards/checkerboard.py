"""Checkerboards: plain ones as people have them, and ours with one hollow corner square (T1).

A plain board looks the same from two sides unless one of its counts of squares is even and the
other odd: then the colours of the corner squares tell. Where they do not, the arm does
(:mod:`armsight.calibration.board_turns`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Points
from armsight.calibration.boards.base import (
    LARGEST,
    Detection,
    Miss,
    Tile,
    Turn,
    grid_points,
    grid_turns,
    whole,
)
from armsight.calibration.corners import classic_checkerboard, exposure_problem, refine
from armsight.errors import UsageError


@dataclass(frozen=True)
class Checkerboard:
    """Squares, one corner square of which may be hollow.

    The origin is the first inner corner, beside the hollow square where there is one, x along
    ``columns``.

    Attributes:
        columns, rows: squares across and down (T1: 7 and 5).
        square: edge [m].
        hollow: whether the first corner square is a dark frame about a white centre.
        rim: thickness of that frame, as a share of the square.
    """

    columns: int = 7
    rows: int = 5
    square: float = 0.03
    hollow: bool = True
    rim: float = 0.22

    def __post_init__(self) -> None:
        if self.columns < 4 or self.rows < 4 or self.square <= 0:
            raise UsageError(
                f"checkerboard of {self.columns}x{self.rows} squares of {self.square} m: "
                "needs at least 4x4 squares of more than 0 m"
            )
        if max(self.columns, self.rows) > LARGEST:
            raise UsageError(
                f"checkerboard of {self.columns}x{self.rows} squares: at most {LARGEST} in a row"
            )
        if self.hollow and (self.columns % 2 == 0 or self.rows % 2 == 0):
            raise UsageError(
                f"checkerboard of {self.columns}x{self.rows} squares: the hollow corner needs odd "
                "numbers of squares, so that all four corner squares are dark"
            )

    @property
    def inner(self) -> tuple[int, int]:
        """Inner corners across and down."""
        return self.columns - 1, self.rows - 1

    @cached_property
    def points(self) -> Points:
        """(k, 3) inner corners, row by row [m]."""
        return grid_points(*self.inner, self.square)

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the squares [m]."""
        s = self.square
        return -s, -s, (self.columns - 1) * s, (self.rows - 1) * s

    @property
    def coloured(self) -> bool:
        """The colours of the squares tell the board from itself turned by half a turn."""
        return (self.columns + self.rows) % 2 == 1

    @cached_property
    def turns(self) -> tuple[Turn, ...]:
        """Ways to read a plain board whose colours do not tell."""
        if self.hollow or self.coloured:
            return ()
        # A board as wide as high: quarter turns change the colours unless its count is odd.
        return grid_turns(*self.inner, quarter=self.columns % 2 == 1)

    def tiles(self) -> list[Tile]:
        """Dark squares, and the white centre of the hollow one."""
        s = self.square
        out = [
            Tile((i - 1) * s, (j - 1) * s, i * s, j * s, True)
            for i in range(self.columns)
            for j in range(self.rows)
            if (i + j) % 2 == 0
        ]
        if self.hollow:
            r = self.rim * s
            out.append(Tile(-s + r, -s + r, -r, -r, False))
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find all inner corners, in order from the first corner square."""
        problem = exposure_problem(gray)
        a, b = self.inner
        found = None if problem == "black" else classic_checkerboard(gray, a, b)
        if found is None:
            return Miss(f"image is {problem}" if problem else "no board found")
        grid = found.reshape(b, a, 2)
        across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if across[0] * down[1] - across[1] * down[0] < 0:
            grid = grid[:, ::-1]  # counted in mirror order
        if self.hollow:
            turned = self._hollow_first(gray, grid)
            if turned is None:
                return Miss("the hollow corner square is not clear: too dark, too far or blurred")
            grid = turned
        else:
            grid = self._dark_first(gray, grid)
        rough = grid.reshape(-1, 2)
        pixel = refine(gray, rough, a)
        if self.hollow:
            # The hollow square's white centre would draw its corner away (by more than a pixel):
            # a window that stays within the rim, or none at all.
            near = refine(gray, rough, a, 0.75 * self.rim)
            pixel[0] = near[0]
            if np.linalg.norm(pixel[1] - pixel[0]) * self.rim < 2.0:
                pixel[0] = np.nan
        corner = np.flatnonzero(np.isfinite(pixel[:, 0]))
        return whole(self.points, corner, pixel[corner])

    def _levels(self, gray: Bytes, grid: Floats) -> tuple[Floats, float, float] | None:
        """Brightness of the four corner squares, of dark and of light squares."""
        a, b = self.inner
        source = np.array([[0, 0], [a - 1, 0], [a - 1, b - 1], [0, b - 1]], np.float32)
        image = grid[[0, 0, -1, -1], [0, -1, -1, 0]].astype(np.float32)
        H = np.asarray(cv2.getPerspectiveTransform(source, image), np.float64)
        inset = 0.5 - self.rim
        offset: Floats = np.mgrid[-2:3, -2:3].reshape(2, -1).T * (0.3 * inset)
        places = ((-0.5, -0.5), (a - 0.5, -0.5), (a - 0.5, b - 0.5), (-0.5, b - 0.5))
        corner = np.array([_sample(gray, H, np.array(p) + offset).mean() for p in places])
        cells = [(i, j) for j in range(b - 1) for i in range(a - 1)]
        level = np.array([_sample(gray, H, np.array(c) + 0.5 + offset).mean() for c in cells])
        even = np.array([(i + j) % 2 == 0 for i, j in cells])
        first, second = float(np.median(level[even])), float(np.median(level[~even]))
        return corner, first, second

    def _dark_first(self, gray: Bytes, grid: Floats) -> Floats:
        """The grid counted so that the first corner square is a dark one, where colours tell."""
        levels = self._levels(gray, grid)
        if levels is None:
            return grid
        _, first, second = levels
        if self.columns == self.rows and self.columns % 2 == 0 and first > second:
            return np.rot90(grid)  # a quarter turn changes the colours
        return grid[::-1, ::-1] if self.coloured and first > second else grid

    def _hollow_first(self, gray: Bytes, grid: Floats) -> Floats | None:
        """The grid counted from the hollow square; None when no corner square stands out."""
        levels = self._levels(gray, grid)
        if levels is None:
            return None
        bright, dark, light = levels
        if light - dark < 8:
            return None
        share = (bright - dark) / (light - dark)
        best = int(np.argmax(share))
        others = np.delete(share, best)
        if share[best] < 0.35 or share[best] - others.max() < 0.25:
            return None
        if best == 0:
            return grid
        if best == 2:
            return grid[::-1, ::-1]
        return None  # a hollow square where a turn of the board cannot put it: mirrored or wrong

    def describe(self) -> str:
        """One line for people."""
        hollow = ", first corner square hollow" if self.hollow else ""
        a, b = self.inner
        return (
            f"checkerboard of {self.columns}x{self.rows} squares ({a}x{b} inner corners) of "
            f"{1e3 * self.square:g} mm{hollow}"
        )


def _sample(gray: Bytes, H: Floats, at: Floats) -> Floats:
    """Brightness at (n, 2) places of the board's grid through a homography."""
    p = np.column_stack([at, np.ones(len(at))]) @ H.T
    uv = np.rint(p[:, :2] / p[:, 2:]).astype(int)
    uv[:, 0] = np.clip(uv[:, 0], 0, gray.shape[1] - 1)
    uv[:, 1] = np.clip(uv[:, 1], 0, gray.shape[0] - 1)
    return gray[uv[:, 1], uv[:, 0]].astype(float)
