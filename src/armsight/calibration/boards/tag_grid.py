"""Grids of numbered tags: AprilTag, ArUco, Kalibr's Aprilgrid, single tags."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Points
from armsight.calibration.boards.base import LARGEST, Detection, Miss, Tile, Turn, partial
from armsight.calibration.boards.markers import dictionary, marker_tiles
from armsight.calibration.corners import exposure_problem, refine, straightness
from armsight.errors import UsageError


@dataclass(frozen=True)
class TagGrid:
    """A grid of numbered tags; each gives four corners. A single tag is a grid of one.

    The origin is the top left corner of the top left tag.

    Attributes:
        columns, rows: tags across and down.
        tag: edge of the dark square [m].
        gap: between tags, as a share of the edge.
        first: number of the first tag.
        dictionary: OpenCV's name.
        kalibr: as Kalibr prints it: tags counted from the bottom row, a rim of two cells, and a
            dark square at every crossing of gaps.
    """

    columns: int = 6
    rows: int = 4
    tag: float = 0.03
    gap: float = 0.3
    first: int = 0
    dictionary: str = "DICT_APRILTAG_36H11"
    kalibr: bool = False

    def __post_init__(self) -> None:
        if self.tag <= 0 or self.gap < 0 or min(self.columns, self.rows) < 1:
            raise UsageError(
                f"tag grid of {self.columns}x{self.rows} tags of {self.tag} m, gap {self.gap}: "
                "needs at least one tag of more than 0 m"
            )
        if max(self.columns, self.rows) > LARGEST:
            raise UsageError(f"tag grid of {self.columns}x{self.rows}: at most {LARGEST} in a row")
        last, there = self.first + self.columns * self.rows, len(self._marks.bytesList)
        if self.first < 0 or last > there:
            raise UsageError(
                f"tag grid of {self.columns}x{self.rows} from number {self.first} needs numbers to "
                f"{last - 1}, {self.dictionary} has {there}"
            )

    @cached_property
    def _marks(self) -> cv2.aruco.Dictionary:
        return dictionary(self.dictionary)

    @property
    def border(self) -> int:
        """Cells of dark rim about a tag's code."""
        return 2 if self.kalibr else 1

    @property
    def step(self) -> float:
        """From tag to tag [m]."""
        return self.tag * (1 + self.gap)

    def _number(self, column: int, row: int) -> int:
        """Number of the tag in a column and row, both counted from the top left."""
        return self.first + (self.rows - 1 - row if self.kalibr else row) * self.columns + column

    @cached_property
    def points(self) -> Points:
        """(k, 3) corners of the tags: top left, top right, bottom right, bottom left of each."""
        corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * self.tag
        return np.concatenate(
            [
                corner + np.array([i * self.step, j * self.step, 0.0])
                for j in range(self.rows)
                for i in range(self.columns)
            ]
        )

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the tags, with Kalibr's dark squares [m]."""
        rim = self.gap * self.tag if self.kalibr else 0.0
        x, y, _ = self.points.max(0)
        return -rim, -rim, float(x) + rim, float(y) + rim

    @property
    def turns(self) -> tuple[Turn, ...]:
        """None: numbers tell."""
        return ()

    def tiles(self) -> list[Tile]:
        """The tags as small squares."""
        out: list[Tile] = []
        for j in range(self.rows):
            for i in range(self.columns):
                x, y = i * self.step, j * self.step
                out += marker_tiles(self._marks, self._number(i, j), x, y, self.tag, self.border)
        if self.kalibr:
            g = self.gap * self.tag
            for j in range(self.rows + 1):
                for i in range(self.columns + 1):
                    x, y = i * self.step - g, j * self.step - g
                    out.append(Tile(x, y, x + g, y + g, True))
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the tags that are there."""
        problem = exposure_problem(gray)
        if problem == "black":
            return Miss("image is black")
        corners, ids = self._markers(gray)
        place = {
            self._number(i, j): j * self.columns + i
            for j in range(self.rows)
            for i in range(self.columns)
        }
        index, pixels = [], []
        for corner, number in zip(corners, ids):
            if int(number) in place:
                index.append(place[int(number)])
                pixels.append(corner)
        if not index:
            strange = f" (numbers seen: {_few(ids)})" if len(ids) else ""
            return Miss(
                f"image is {problem}" if problem else f"no tag of this board found{strange}"
            )
        ids_of: Ints = np.concatenate([4 * k + np.arange(4) for k in index])
        upright = self._upright(ids_of, np.array(pixels))
        if self.kalibr:  # tag and dark square meet in a saddle, as on a checkerboard
            upright = refine(gray, upright, 0, 0.42)
        return partial(self.points, ids_of, upright, self.tag)

    def _markers(self, gray: Bytes) -> tuple[Floats, Ints]:
        """(t, 4, 2) corners of all tags in an image [px], and their (t,) numbers."""
        parameters = cv2.aruco.DetectorParameters()
        parameters.markerBorderBits = self.border
        if self.kalibr:
            parameters.adaptiveThreshWinSizeMax = 53
        else:
            parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        detector = cv2.aruco.ArucoDetector(self._marks, parameters)
        found: dict[int, Floats] = {}
        # Kalibr's tags touch the dark squares at their corners: set apart, more are found.
        for width in (0, 3) if self.kalibr else (0,):
            image = cv2.dilate(gray, np.ones((width, width), np.uint8)) if width else gray
            corners, ids, _ = detector.detectMarkers(image)
            for corner, number in zip(corners, np.ravel(ids) if ids is not None else ()):
                pixel = np.asarray(corner, float).reshape(4, 2)
                if width:  # dilation moved the edges inwards
                    middle = pixel.mean(0)
                    edge = np.linalg.norm(pixel - np.roll(pixel, 1, 0), axis=1).mean()
                    pixel = middle + (pixel - middle) * (1 + (width - 1) / edge)
                elif not self.kalibr:
                    # The refinement counts pixel centres from a half (measured: +0.46 px).
                    pixel = pixel - 0.5
                found.setdefault(int(number), pixel)
        return np.array(list(found.values())).reshape(-1, 4, 2), np.array(list(found), np.int64)

    def _upright(self, corner: Ints, pixels: Floats) -> Floats:
        """(m, 2) corners in our order, whatever way up this printer's tags stand.

        AprilTag's own library and OpenCV turn the same code differently; all tags of a grid agree,
        and only one way lies flat.
        """
        ways = [np.roll(pixels, k, axis=1).reshape(-1, 2) for k in range(4)]
        if len(pixels) < 2:
            return ways[0]
        flat = np.asarray(self.points[corner, :2], np.float64)
        return ways[int(np.argmin([straightness(flat, way) for way in ways]))]

    def describe(self) -> str:
        """One line for people."""
        if self.columns == self.rows == 1:
            return f"tag {self.first} of {self.dictionary}, {1e3 * self.tag:g} mm"
        kind = "Kalibr Aprilgrid" if self.kalibr else "tag grid"
        return (
            f"{kind} of {self.columns}x{self.rows} tags of {1e3 * self.tag:g} mm, gaps "
            f"{1e3 * self.tag * self.gap:.4g} mm, {self.dictionary}"
        )


def _few(numbers: Ints) -> str:
    some = sorted({int(n) for n in numbers})
    return ", ".join(map(str, some[:4])) + (" ..." if len(some) > 4 else "")
