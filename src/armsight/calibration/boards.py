"""Calibration boards: their corners, their look, and how to find them in an image.

Board frame: z = 0 on the print, x to the right and y down as it is read, z into the paper, so that
a board seen straight on has the camera's axes. Pixel centres count from 0.

A checkerboard looks the same from two sides; one corner square is therefore printed hollow (T1),
and the corners are counted from it. ChArUco boards and AprilTag grids carry numbers and may be seen
in part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Points
from armsight.calibration.corners import (
    classic_checkerboard,
    exposure_problem,
    refine,
    straightness,
)
from armsight.errors import UsageError

Tile = tuple[float, float, float, float, bool]
"""x0, y0, x1, y1 [m] in the board's frame, and whether it is dark; later tiles cover earlier."""


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

    def tiles(self) -> list[Tile]:
        """The print as rectangles on white."""
        ...

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the board in an (h, w) uint8 image."""
        ...

    def describe(self) -> str:
        """One line for people."""
        ...


@dataclass(frozen=True)
class Checkerboard:
    """Squares, one corner square of which is hollow.

    The origin is the inner corner beside the hollow square, x along ``columns``.

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
        a, b = self.inner
        y, x = np.mgrid[0:b, 0:a]
        return np.stack([x.ravel(), y.ravel(), np.zeros(a * b)], axis=1) * self.square

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the squares [m]."""
        s = self.square
        return -s, -s, (self.columns - 1) * s, (self.rows - 1) * s

    def tiles(self) -> list[Tile]:
        """Dark squares, and the white centre of the hollow one."""
        s = self.square
        out: list[Tile] = []
        for i in range(self.columns):
            for j in range(self.rows):
                if (i + j) % 2 == 0:
                    out.append(((i - 1) * s, (j - 1) * s, i * s, j * s, True))
        if self.hollow:
            r = self.rim * s
            out.append((-s + r, -s + r, -r, -r, False))
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find all inner corners, in order from the hollow square."""
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
        rough = grid.reshape(-1, 2)
        pixel = refine(gray, rough, a, 0.42)
        if self.hollow:
            # The hollow square's white centre would draw its corner away (by more than a pixel):
            # a window that stays within the rim, or none at all.
            near = refine(gray, rough, a, 0.75 * self.rim)
            pixel[0] = near[0]
            if np.linalg.norm(pixel[1] - pixel[0]) * self.rim < 2.0:
                pixel[0] = np.nan
        return self._checked(gray, pixel)

    def _hollow_first(self, gray: Bytes, grid: Floats) -> Floats | None:
        """The grid counted from the hollow square; None when no corner square stands out."""
        a, b = self.inner
        source = np.array([[0, 0], [a - 1, 0], [a - 1, b - 1], [0, b - 1]], np.float32)
        image = grid[[0, 0, -1, -1], [0, -1, -1, 0]].astype(np.float32)
        H = np.asarray(cv2.getPerspectiveTransform(source, image), np.float64)
        bright = []
        inset = 0.5 - self.rim
        offset: Floats = np.mgrid[-2:3, -2:3].reshape(2, -1).T * (0.3 * inset)
        for x, y in ((-0.5, -0.5), (a - 0.5, -0.5), (a - 0.5, b - 0.5), (-0.5, b - 0.5)):
            bright.append(float(_sample(gray, H, np.array([x, y]) + offset).mean()))
        inner = np.array([[i + 0.5, j + 0.5] for j in range(b - 1) for i in range(a - 1)])
        level = np.array([_sample(gray, H, c + offset).mean() for c in inner])
        dark_cell = np.array([(i + j) % 2 == 0 for j in range(b - 1) for i in range(a - 1)])
        dark, light = np.median(level[dark_cell]), np.median(level[~dark_cell])
        if light - dark < 8:
            return None
        share = (np.array(bright) - dark) / (light - dark)
        best = int(np.argmax(share))
        others = np.delete(share, best)
        if share[best] < 0.35 or share[best] - others.max() < 0.25:
            return None
        if best == 0:
            return grid
        if best == 2:
            return grid[::-1, ::-1]
        return None  # a hollow square where a turn of the board cannot put it: mirrored or wrong

    def _checked(self, gray: Bytes, pixel: Floats) -> Detection | Miss:
        corner = np.flatnonzero(np.isfinite(pixel[:, 0]))
        pixel = pixel[corner]
        flat = np.asarray(self.points[corner, :2], np.float64)
        spread = straightness(flat, pixel)
        spacing = float(np.linalg.norm(pixel[2] - pixel[1]))
        if spread > max(1.0, 0.08 * spacing):
            return Miss(f"corners do not lie on a flat board ({spread:.1f} px)")
        return Detection(corner, pixel, spread)

    def describe(self) -> str:
        """One line for people."""
        hollow = ", first corner square hollow" if self.hollow else ""
        return f"checkerboard {self.columns}x{self.rows} of {1e3 * self.square:g} mm{hollow}"


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    key = name.upper()
    if not hasattr(cv2.aruco, key):
        known = ", ".join(sorted(k for k in dir(cv2.aruco) if k.startswith("DICT_")))
        raise UsageError(f"no marker dictionary '{name}'; choose one of {known}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, key))


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

    @cached_property
    def _board(self) -> cv2.aruco.CharucoBoard:
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, _dictionary(self.dictionary)
        )
        board.setLegacyPattern(self.legacy)
        return board

    @cached_property
    def points(self) -> Points:
        """(k, 3) inner corners [m]."""
        return np.array(self._board.getChessboardCorners(), float).reshape(-1, 3)

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the squares [m]."""
        return 0.0, 0.0, self.columns * self.square, self.rows * self.square

    def tiles(self) -> list[Tile]:
        """Dark squares, and markers as small squares."""
        s = self.square
        dark_first = 0 if not self.legacy or self.rows % 2 else 1
        out: list[Tile] = [
            (i * s, j * s, (i + 1) * s, (j + 1) * s, True)
            for j in range(self.rows)
            for i in range(self.columns)
            if (i + j) % 2 == dark_first
        ]
        for tag, corners in zip(np.ravel(self._board.getIds()), self._board.getObjPoints()):
            x0, y0 = np.asarray(corners).reshape(-1, 3)[:, :2].min(0)
            out += _marker_tiles(_dictionary(self.dictionary), int(tag), x0, y0, self.marker)
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the corners that are there, refined on the image itself."""
        problem = exposure_problem(gray)
        if problem == "black":
            return Miss("image is black")
        parameters = cv2.aruco.CharucoParameters()
        detector = cv2.aruco.CharucoDetector(self._board, parameters)
        pixel, ids, _, _ = detector.detectBoard(gray)
        if ids is None or len(ids) < 4:
            seen = 0 if ids is None else len(ids)
            return Miss(f"image is {problem}" if problem else f"only {seen} corners found")
        # OpenCV interpolates corners by a homography without distortion: refine on the image, in a
        # window that does not reach the markers.
        gap = 0.5 * (self.square - self.marker) / self.square
        corner: Ints = np.asarray(ids, np.int64).ravel()
        refined = refine(gray, np.asarray(pixel, float).reshape(-1, 2), 0, min(0.42, gap + 0.05))
        return _partial(self.points, corner, refined, self.square)

    def describe(self) -> str:
        """One line for people."""
        return (
            f"ChArUco board {self.columns}x{self.rows} of {1e3 * self.square:g} mm, markers "
            f"{1e3 * self.marker:g} mm of {self.dictionary}"
        )


@dataclass(frozen=True)
class AprilTagGrid:
    """A grid of numbered tags; each gives four corners. A single tag is a grid of one.

    The origin is the first corner of the first tag.

    Attributes:
        columns, rows: tags across and down.
        tag: edge of the dark square [m].
        gap: between tags, as a share of the edge.
        first: number of the first tag.
        dictionary: OpenCV's name.
    """

    columns: int = 6
    rows: int = 4
    tag: float = 0.03
    gap: float = 0.3
    first: int = 0
    dictionary: str = "DICT_APRILTAG_36h11"

    @cached_property
    def points(self) -> Points:
        """(k, 3) corners of the tags: top left, top right, bottom right, bottom left of each."""
        step = self.tag * (1 + self.gap)
        corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * self.tag
        return np.concatenate(
            [
                corner + np.array([i * step, j * step, 0.0])
                for j in range(self.rows)
                for i in range(self.columns)
            ]
        )

    @property
    def outline(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the tags [m]."""
        top = self.points.max(0)
        return 0.0, 0.0, float(top[0]), float(top[1])

    def tiles(self) -> list[Tile]:
        """The tags as small squares."""
        out: list[Tile] = []
        dictionary = _dictionary(self.dictionary.replace("36h11", "36H11"))
        step = self.tag * (1 + self.gap)
        for j in range(self.rows):
            for i in range(self.columns):
                tag = self.first + j * self.columns + i
                out += _marker_tiles(dictionary, tag, i * step, j * step, self.tag)
        return out

    def detect(self, gray: Bytes) -> Detection | Miss:
        """Find the tags that are there."""
        problem = exposure_problem(gray)
        if problem == "black":
            return Miss("image is black")
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        dictionary = _dictionary(self.dictionary.replace("36h11", "36H11"))
        corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(gray)
        found: list[tuple[int, Floats]] = []
        count = self.columns * self.rows
        for corner, tag in zip(corners, np.ravel(ids) if ids is not None else ()):
            index = int(tag) - self.first
            if 0 <= index < count:
                # This refinement counts pixel centres from a half (measured: +0.46 px), we from 0.
                found.append((index, np.asarray(corner, float).reshape(4, 2) - 0.5))
        if not found:
            return Miss(f"image is {problem}" if problem else "no tag of this board found")
        corner_ids = np.concatenate([4 * index + np.arange(4) for index, _ in found])
        pixel = np.concatenate([c for _, c in found])
        return _partial(self.points, corner_ids, pixel, self.tag)

    def describe(self) -> str:
        """One line for people."""
        return f"AprilTag grid {self.columns}x{self.rows} of {1e3 * self.tag:g} mm tags"


def _partial(points: Points, corner: Ints, pixel: Floats, square: float) -> Detection | Miss:
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


def _marker_tiles(
    dictionary: cv2.aruco.Dictionary, tag: int, x0: float, y0: float, size: float
) -> list[Tile]:
    """A marker as its dark square and the white cells on it."""
    cells = int(dictionary.markerSize) + 2
    image = cv2.aruco.generateImageMarker(dictionary, tag, cells, borderBits=1)
    step = size / cells
    out: list[Tile] = [(x0, y0, x0 + size, y0 + size, True)]
    for j, i in zip(*np.nonzero(image)):
        out.append((x0 + i * step, y0 + j * step, x0 + (i + 1) * step, y0 + (j + 1) * step, False))
    return out


def _sample(gray: Bytes, H: Floats, at: Floats) -> Floats:
    """Brightness at (n, 2) places of the board's grid through a homography."""
    p = np.column_stack([at, np.ones(len(at))]) @ H.T
    uv = np.rint(p[:, :2] / p[:, 2:]).astype(int)
    uv[:, 0] = np.clip(uv[:, 0], 0, gray.shape[1] - 1)
    uv[:, 1] = np.clip(uv[:, 1], 0, gray.shape[0] - 1)
    return gray[uv[:, 1], uv[:, 0]].astype(float)


def raster(board: Board, per_meter: float, margin: float) -> tuple[Bytes, float, float]:
    """The print as an image: (h, w) uint8, and x, y of its first pixel's outer corner [m].

    Args:
        board: which.
        per_meter: pixels a metre.
        margin: white rim about it [m].
    """
    x0, y0, x1, y1 = board.outline
    x0, y0, x1, y1 = x0 - margin, y0 - margin, x1 + margin, y1 + margin
    image = np.full((round((y1 - y0) * per_meter), round((x1 - x0) * per_meter)), 255, np.uint8)
    for a, b, c, d, dark in board.tiles():
        u0, u1 = round((a - x0) * per_meter), round((c - x0) * per_meter)
        v0, v1 = round((b - y0) * per_meter), round((d - y0) * per_meter)
        image[v0:v1, u0:u1] = 0 if dark else 255
    return image, x0, y0


def parse_board(text: str) -> Board:
    """A board from words such as ``checkerboard:7x5:30`` (sizes in mm).

    Forms: ``checkerboard:COLUMNSxROWS:SQUARE[:plain]``,
    ``charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY]``,
    ``apriltag:COLUMNSxROWS:TAG[:GAP_SHARE[:FIRST]]``.

    Raises:
        UsageError: the words are not understood.
    """
    kind, *rest = text.strip().split(":")
    try:
        columns, rows = (int(n) for n in rest[0].lower().split("x"))
        size = 1e-3 * float(rest[1])
        if kind == "checkerboard":
            return Checkerboard(columns, rows, size, hollow=rest[2:3] != ["plain"])
        if kind == "charuco":
            name = rest[3] if len(rest) > 3 else "DICT_6X6_250"
            return CharucoBoard(columns, rows, size, 1e-3 * float(rest[2]), name)
        if kind == "apriltag":
            gap = float(rest[2]) if len(rest) > 2 else 0.3
            return AprilTagGrid(columns, rows, size, gap, int(rest[3]) if len(rest) > 3 else 0)
    except (IndexError, ValueError):
        pass
    raise UsageError(
        f"board '{text}' is not understood; write for example checkerboard:7x5:30, "
        "charuco:5x7:36:27:DICT_6X6_250 or apriltag:6x4:30:0.3 (sizes in mm)"
    )
