"""ChArUco boards: checkerboards with numbered markers, in OpenCV's layouts before and after 4.6."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from armsight.arrays import Bytes, Ints, Points
from armsight.calibration.boards.base import LARGEST, Detection, Miss, Tile, Turn, partial
from armsight.calibration.boards.markers import dictionary, marker_tiles
from armsight.calibration.corners import exposure_problem, refine
from armsight.errors import UsageError


@dataclass(frozen=True)
class CharucoBoard:
    """A checkerboard with a numbered marker in every white square; may be seen in part.

    The origin is the board's outer corner.

    Attributes:
        columns, rows: squares across and down.
        square, marker: edges [m].
        dictionary: OpenCV's name of the markers.
        legacy: the pattern of OpenCV before 4.6 for even numbers of rows.
    """

    columns: int = 5
    rows: int = 7
    square: float = 0.036
    marker: float = 0.027
    dictionary: str = "DICT_6X6_250"
    legacy: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.marker < self.square:
            raise UsageError(
                f"ChArUco board: marker {self.marker} m must be smaller than square {self.square} m"
            )
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > LARGEST:
            raise UsageError(
                f"ChArUco board of {self.columns}x{self.rows} squares: 3 to {LARGEST} in a row"
            )
        needed, there = self.columns * self.rows // 2, len(dictionary(self.dictionary).bytesList)
        if needed > there:
            raise UsageError(
                f"ChArUco board of {self.columns}x{self.rows} squares needs {needed} markers, "
                f"{self.dictionary} has {there}"
            )

    @cached_property
    def _board(self) -> cv2.aruco.CharucoBoard:
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, dictionary(self.dictionary)
        )
        board.setLegacyPattern(self.legacy)
        return board

    @cached_property
    def _other(self) -> CharucoBoard | None:
        """The same board in the other layout; None where both are one."""
        return replace(self, legacy=not self.legacy) if self.rows % 2 == 0 else None

    @cached_property
    def points(self) -> Points:
        """(k, 3) inner corners [m]."""
        return np.array(self._board.getChessboardCorners(), float).reshape(-1, 3)

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the squares [m]."""
        return 0.0, 0.0, self.columns * self.square, self.rows * self.square

    @property
    def turns(self) -> tuple[Turn, ...]:
        """None: markers tell."""
        return ()

    def tiles(self) -> list[Tile]:
        """Dark squares, and markers as small squares."""
        s = self.square
        dark_first = 0 if not self.legacy or self.rows % 2 else 1
        out = [
            Tile(i * s, j * s, (i + 1) * s, (j + 1) * s, True)
            for j in range(self.rows)
            for i in range(self.columns)
            if (i + j) % 2 == dark_first
        ]
        for tag, corners in zip(np.ravel(self._board.getIds()), self._board.getObjPoints()):
            x0, y0 = np.asarray(corners).reshape(-1, 3)[:, :2].min(0)
            out += marker_tiles(dictionary(self.dictionary), int(tag), x0, y0, self.marker)
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the corners that are there, refined on the image itself.

        Both layouts have their corners in the same places: where the one that was named gives
        nothing, the other one is tried.
        """
        found = self._detect(gray)
        if isinstance(found, Miss) and self._other is not None:
            other = self._other._detect(gray)
            return other if isinstance(other, Detection) else found
        return found

    def _detect(self, gray: Bytes) -> Detection | Miss:
        problem = exposure_problem(gray)
        if problem == "black":
            return Miss("image is black")
        detector = cv2.aruco.CharucoDetector(self._board, cv2.aruco.CharucoParameters())
        pixel, ids, _, _ = detector.detectBoard(gray)
        if ids is None or len(ids) < 4:
            seen = 0 if ids is None else len(ids)
            return Miss(f"image is {problem}" if problem else f"only {seen} corners found")
        # OpenCV interpolates corners by a homography without distortion: refine on the image, in a
        # window that does not reach the markers.
        gap = 0.5 * (self.square - self.marker) / self.square
        corner: Ints = np.asarray(ids, np.int64).ravel()
        refined = refine(gray, np.asarray(pixel, float).reshape(-1, 2), 0, min(0.42, gap + 0.05))
        return partial(self.points, corner, refined, self.square)

    def describe(self) -> str:
        """One line for people."""
        return (
            f"ChArUco board of {self.columns}x{self.rows} squares of {1e3 * self.square:g} mm, "
            f"markers {1e3 * self.marker:g} mm of {self.dictionary}"
            + (", layout before OpenCV 4.6" if self.legacy else "")
        )
