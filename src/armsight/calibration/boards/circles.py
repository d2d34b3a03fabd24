"""Circle grids, symmetric and asymmetric; the eccentricity of circles in perspective is corrected.

The middle of a circle's image is not the image of its middle: for a circle of radius r, tilted and
near, they differ by a good part of a pixel. From the homography of the board the image of each
circle is known as a conic, and with it the difference (Heikkila, IEEE Trans. Pattern Analysis and
Machine Intelligence 22(10), 2000, section 3); it is taken away.
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
from armsight.calibration.corners import exposure_problem, resized, unscaled
from armsight.errors import UsageError


@dataclass(frozen=True)
class CircleGrid:
    """Dark circles on white.

    The origin is the middle of the first circle. In an asymmetric grid every second row is shifted
    by half the distance of two circles of a row, as in OpenCV.

    Attributes:
        columns, rows: circles in a row, and rows.
        spacing: from middle to middle: of neighbours, or in an asymmetric grid half the distance
            of two circles of a row (OpenCV's ``square size``) [m].
        diameter: of a circle [m].
        asymmetric: every second row is shifted.
    """

    columns: int = 7
    rows: int = 5
    spacing: float = 0.03
    diameter: float = 0.015
    asymmetric: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > LARGEST:
            raise UsageError(f"circles of {self.columns}x{self.rows}: 3 to {LARGEST} in a row")
        room = self.spacing * (np.sqrt(2) if self.asymmetric else 1.0)
        if not 0 < self.diameter < room:
            raise UsageError(
                f"circles of {1e3 * self.diameter:g} mm overlap {1e3 * room:.4g} mm apart; give "
                "the diameter after the spacing"
            )

    @cached_property
    def points(self) -> Points:
        """(k, 3) middles of the circles, row by row [m]."""
        if not self.asymmetric:
            return grid_points(self.columns, self.rows, self.spacing)
        return np.array(
            [
                [(2 * i + j % 2) * self.spacing, j * self.spacing, 0.0]
                for j in range(self.rows)
                for i in range(self.columns)
            ]
        )

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the print [m]."""
        r = 0.5 * self.diameter
        x, y, _ = self.points.max(0)
        return -r, -r, float(x) + r, float(y) + r

    @cached_property
    def turns(self) -> tuple[Turn, ...]:
        """Half a turn where nothing tells: always but for asymmetric grids of odd rows."""
        if self.asymmetric and self.rows % 2 == 1:
            return ()
        return grid_turns(self.columns, self.rows, quarter=not self.asymmetric)

    def tiles(self) -> list[Tile]:
        """The circles."""
        r = 0.5 * self.diameter
        return [Tile(x - r, y - r, x + r, y + r, True, True) for x, y, _ in self.points]

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find all circles, their middles corrected for perspective."""
        problem = exposure_problem(gray)
        found = None if problem == "black" else self._find(gray)
        if found is None:
            return Miss(f"image is {problem}" if problem else "no circle grid found")
        grid = found.reshape(self.rows, self.columns, 2)
        across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if across[0] * down[1] - across[1] * down[0] < 0:  # counted in mirror order
            grid = grid[::-1] if self.asymmetric else grid[:, ::-1]
        pixel = _centroids(gray, grid.reshape(-1, 2), self)
        return whole(self.points, np.arange(len(pixel)), self._uncentred(pixel))

    def _find(self, gray: Bytes) -> Floats | None:
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        for longest in (1000.0, 1800.0, 600.0):
            scale = min(longest / max(gray.shape), 2.0)
            image = resized(gray, scale)
            for dark in (True, False):
                parameters = cv2.SimpleBlobDetector.Params()
                parameters.filterByColor = True
                parameters.blobColor = 0 if dark else 255
                parameters.minArea, parameters.maxArea = 12.0, 0.02 * image.size
                parameters.minDistBetweenBlobs = 3.0
                parameters.filterByInertia = True
                parameters.minInertiaRatio = 0.05  # tilted circles are slim
                blobs = cv2.SimpleBlobDetector.create(parameters)
                for flags in (kind | cv2.CALIB_CB_CLUSTERING, kind):
                    ok, found = cv2.findCirclesGrid(
                        image, (self.columns, self.rows), flags=flags, blobDetector=blobs
                    )
                    if ok and found is not None:
                        return unscaled(np.asarray(found, float).reshape(-1, 2), scale)
        return None

    def _uncentred(self, pixel: Floats) -> Floats:
        """Images of the middles from the middles of the images."""
        flat = np.asarray(self.points[:, :2], np.float64)
        out = pixel
        for _ in range(3):
            H: Floats | None = cv2.findHomography(flat, out, 0)[0]  # type: ignore[assignment]
            if H is None:
                return pixel
            out = pixel - eccentricity(np.asarray(H, np.float64), flat, 0.5 * self.diameter)
        return out

    def describe(self) -> str:
        """One line for people."""
        kind = "asymmetric circle grid" if self.asymmetric else "circle grid"
        return (
            f"{kind} of {self.columns}x{self.rows}, {1e3 * self.spacing:g} mm apart, circles of "
            f"{1e3 * self.diameter:g} mm"
        )


def eccentricity(H: Floats, middles: Floats, radius: float) -> Floats:
    """(n, 2) middle of each circle's image minus the image of its middle [px].

    Args:
        H: (3, 3) homography from the board to the image.
        middles: (n, 2) of the circles on the board [m].
        radius: [m].
    """
    x, y = middles[:, 0], middles[:, 1]
    conic = np.zeros((len(middles), 3, 3))
    conic[:, 0, 0] = conic[:, 1, 1] = 1.0
    conic[:, 0, 2] = conic[:, 2, 0] = -x
    conic[:, 1, 2] = conic[:, 2, 1] = -y
    conic[:, 2, 2] = x * x + y * y - radius**2
    # Dual conics map without inverses: C* -> H C* H^T; the middle is the pole of infinity.
    dual = H @ np.linalg.inv(conic) @ H.T
    middle = dual[:, :2, 2] / dual[:, 2:, 2]
    p = np.column_stack([middles, np.ones(len(middles))]) @ H.T
    return np.asarray(middle - p[:, :2] / p[:, 2:], np.float64)


def _centroids(gray: Bytes, rough: Floats, board: CircleGrid) -> Floats:
    """Centres of gravity of what is darker (or lighter) than the paper about each circle."""
    flat = np.asarray(board.points[:, :2], np.float64)
    found: Floats | None = cv2.findHomography(flat, rough, 0)[0]  # type: ignore[assignment]
    if found is None:
        return rough
    H = np.asarray(found, np.float64)
    room = board.spacing * (np.sqrt(2) if board.asymmetric else 1.0)
    reach = 0.5 * (0.5 * board.diameter + 0.5 * room)  # to the middle of the white between
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    out = rough.copy()
    for k, (middle, p) in enumerate(zip(flat, rough)):
        edge = _project(H, middle + reach * ring) + (p - _project(H, middle[None])[0])
        x0, y0 = np.floor(edge.min(0)).astype(int)
        x1, y1 = np.ceil(edge.max(0)).astype(int) + 1
        if x0 < 0 or y0 < 0 or x1 > gray.shape[1] or y1 > gray.shape[0] or x1 - x0 < 4:
            continue
        patch = gray[y0:y1, x0:x1].astype(float)
        mask = np.zeros(patch.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.rint((edge - [x0, y0]) * 16).astype(np.int32), 1, shift=4)
        inside = mask > 0
        paper = _at(gray, edge)
        ink = float(gray[round(float(p[1])), round(float(p[0]))])
        # A slanted light makes paper brighter on one side: a plane through the ring.
        A = np.column_stack([edge - p, np.ones(len(edge))])
        plane = np.linalg.lstsq(A, paper, rcond=None)[0]
        v, u = np.nonzero(inside)
        level = np.column_stack([u + x0 - p[0], v + y0 - p[1], np.ones(len(u))]) @ plane
        share = (level - patch[v, u]) / np.where(np.abs(level - ink) < 1, 1.0, level - ink)
        share = np.clip(share, 0.0, 1.2)
        share[share < 0.12] = 0.0  # noise of the paper draws the centre inwards
        if share.sum() > 3:
            out[k] = [x0 + (u * share).sum() / share.sum(), y0 + (v * share).sum() / share.sum()]
    return out


def _project(H: Floats, xy: Floats) -> Floats:
    p = np.column_stack([xy, np.ones(len(xy))]) @ H.T
    return np.asarray(p[:, :2] / p[:, 2:])


def _at(gray: Bytes, pixel: Floats) -> Floats:
    uv = np.rint(pixel).astype(int)
    u = np.clip(uv[:, 0], 0, gray.shape[1] - 1)
    v = np.clip(uv[:, 1], 0, gray.shape[0] - 1)
    return gray[v, u].astype(float)
