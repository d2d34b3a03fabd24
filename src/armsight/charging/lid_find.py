"""Where a shut lid is, by a pair's pictures: four lines that may be its edges, then the joint fit.

A lid is a panel of the body's own paint: what is seen of it are the gap about it and the recess for
fingers beside its free edge. Lines of one picture that close a quadrilateral are taken for the
panel, or for the opening with the recess; each such guess is fitted to both pictures by the edges
of both, and the share of them that is found decides. Which way it is up is known from the car.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.charging.fit import Fit, FitOptions, fit
from armsight.charging.looks import Look, look, window_about
from armsight.charging.ports.outline import Outline
from armsight.charging.ports.table import MM, Port, Rim
from armsight.charging.vehicle_file import HINGES, LID_HALF, LID_RECESS, LidShape
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.geometry.stereo import StereoPair

GAP, RECESS = 4 * MM, LID_RECESS
"""Between lid and body; width of the recess beside its free edge [m]."""
LEAST = 24.0
"""A line that is shorter is no edge of a lid [px]."""
CORNER = 0.5
"""Two lines meet where they cross on both of them, or so far beyond an end, in their own lengths:
what shadows and reflections leave of an edge is often short."""
PIECE, ASIDE = 10.0, 2.0
"""Pieces of one line are at least so long, and no farther off it [px]."""
MOST = 40
"""Lines of each way that are tried, the longest."""
SHARE = 0.7
"""A lid of which less of its edges is found is none."""
BOTH = 0.55
"""And so much in each picture."""
BESIDE = (-GAP, 0.0, GAP)
"""Starts of a fit, aside of where a lid is believed to be [m]."""
TRIES = 16
"""Guesses that are fitted at most, the best in their own picture first."""


@dataclass(frozen=True)
class Rectangle(Outline):
    """An upright rectangle; ``radius`` is half its width.

    Attributes:
        high: half its height [m].
    """

    high: float = 0.0

    def sample(self, step: float) -> tuple[Floats, Floats]:
        """See :meth:`Outline.sample`."""
        points, normals = [], []
        for a, b, out in (
            ((1, -1), (1, 1), (1, 0)),
            ((1, 1), (-1, 1), (0, 1)),
            ((-1, 1), (-1, -1), (-1, 0)),
            ((-1, -1), (1, -1), (0, -1)),
        ):
            size = np.array([self.radius, self.high])
            start, end = size * a, size * b
            n = max(2, round(float(np.linalg.norm(end - start)) / step))
            at = ((np.arange(n) + 0.5) / n)[:, None]
            points.append(np.array([self.x, self.y]) + start + (end - start) * at)
            normals.append(np.tile(np.array(out, float), (n, 1)))
        return np.concatenate(points), np.concatenate(normals)


PANEL = Rectangle(0.0, 0.0, LID_HALF, high=LID_HALF)
OPENING = Rectangle(0.5 * (RECESS - GAP), 0.0, LID_HALF + 0.5 * (RECESS + GAP), high=LID_HALF + GAP)
LID = Port(
    "lid", "charging lid", False,
    (
        Rim("panel", "pedestal", PANEL, 0.0, 0.5 * MM, 0.5 * MM, depth_tolerance=0.5 * MM),
        Rim("opening", "mouth", OPENING, 0.0, 0.5 * MM, 1.0 * MM, depth_tolerance=1.0 * MM),
    ),
    (), PANEL, 0.0, 0.05, 0.0, 1,
)  # fmt: skip
"""In its own frame (:mod:`armsight.charging.lid`), for the joint fit that ports have."""


@dataclass(frozen=True, eq=False)
class LidPose:
    """Where a lid is.

    Attributes:
        T_left_lid: in the left camera's frame; covariance: (6, 6) as a twist in its own [m], [rad].
        score: share of its edges found in both pictures, 0..1.
        fit: all of the fit.
    """

    T_left_lid: Pose
    covariance: Floats
    score: float
    fit: Fit


def find_lid(images: tuple[Bytes, Bytes], pair: StereoPair, shape: LidShape) -> LidPose | None:
    """The surest lid that a pair sees, or None.

    Args:
        images: left and right, grey, the car upright in them within 45 deg.
        pair: that took them.
        shape: which way it opens.
    """
    T_panel_lid = from_rpy((0.0, 0.0, float(np.deg2rad(HINGES[shape.hinge]))))
    rough = []
    for image, lens, T_left_lens in (
        (images[0], pair.left, np.eye(4)),
        (images[1], pair.right, pair.T_left_right),
    ):  # on a flank seen askew only one of them may see into the gap at the hinge
        whole = look(image, lens, inverse(T_left_lens))
        for quad in _quads(image):
            for outline in (PANEL, OPENING):
                for T in _poses(quad, _corners(outline, T_panel_lid), lens):
                    rough.append(_rough(whole, np.asarray(T_left_lens @ T @ T_panel_lid)))
    best: LidPose | None = None
    for one in sorted(rough, key=lambda one: -one.score)[:TRIES]:
        found = _of_both(images, pair, one.T_ref_port)
        if found is not None and (best is None or found.score > best.score):
            best = found
    return None if best is None else fit_lid(images, pair, best.T_left_lid)


def fit_lid(images: tuple[Bytes, Bytes], pair: StereoPair, T_left_lid: Pose) -> LidPose | None:
    """The joint fit to both pictures from a start [``T_left_lid``]; None where it is no lid.

    From near either edge of the gap may be taken for the other: the fit is begun on all sides.
    """
    starts = [T_left_lid @ make_pose(None, (x, y, 0.0)) for x in BESIDE for y in BESIDE]
    fits = [one for T in starts if (one := _of_both(images, pair, T)) is not None]
    best = min(fits, key=lambda one: one.fit.cost / one.fit.points, default=None)
    if best is None or best.score < SHARE:
        return None
    halves = np.split(best.fit.found, 2)
    return best if min(float(half.mean()) for half in halves) >= BOTH else None


def _of_both(images: tuple[Bytes, Bytes], pair: StereoPair, T: Pose) -> LidPose | None:
    """The fit from one start; None where a picture does not show it."""
    lenses, T_lens_left = (pair.left, pair.right), (np.eye(4), inverse(pair.T_left_right))
    looks = []
    for image, lens, T_lens in zip(images, lenses, T_lens_left):
        window = window_about(lens, T_lens @ T, 0.17)
        if window is None:
            return None
        looks.append(look(image, lens, T_lens, window=window))
    found = _fitted(looks, T, 8.0)
    return LidPose(found.T_ref_port, found.covariance, found.score, found)


def _fitted(looks: Sequence[Look], T: Pose, reach: float) -> Fit:
    return fit(looks, LID, T, FitOptions(reach=reach, iterations=8, spacing=2.5, makes=False))


def _rough(view: Look, T: Pose) -> Fit:
    """A few steps in one picture alone, to compare guesses."""
    return fit([view], LID, T, FitOptions(4.0, 2, False, 6.0, 0.01))


def _corners(outline: Rectangle, T_panel_lid: Pose) -> Floats:
    """(4, 3) corners upright: top left, top right, bottom right, bottom left."""
    size, middle = np.array([outline.radius, outline.high]), np.array([outline.x, outline.y])
    p = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * size + middle
    p = np.column_stack([p, np.zeros(4)]) @ T_panel_lid[:3, :3].T
    center = p.mean(axis=0)
    around = np.arctan2((p - center)[:, 1], (p - center)[:, 0])
    return np.asarray(p[np.argsort(-np.mod(around - 0.999 * np.pi, 2 * np.pi))])


def _poses(quad: Floats, corners: Floats, lens: PinholeCamera) -> Iterator[Pose]:
    """Both poses of a plane figure whose corners are seen at a quadrilateral."""
    K = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1.0]])
    distortion = np.asarray(lens.distortion, float)
    ok, turns, shifts, _ = cv2.solvePnPGeneric(
        corners[:, None], quad[:, None].astype(float), K, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    for turn, shift in zip(turns, shifts) if ok else ():
        R, _ = cv2.Rodrigues(turn)
        T = make_pose(R, shift.ravel())
        if np.isfinite(T).all() and R[2, 2] < -0.5 and R[1, 1] < -0.7 and 0.2 < T[2, 3] < 3.0:
            yield T


def _quads(image: Bytes) -> Iterator[Floats]:
    """(4, 2) corners of quadrilaterals that lines close: top left, top right, then below."""
    found: Any = cv2.createLineSegmentDetector().detect(image)[0]
    if found is None:  # there is no line at all
        return
    lines = np.asarray(found, float).reshape(-1, 4)
    way = lines[:, 2:] - lines[:, :2]
    flat = np.abs(way[:, 0]) > np.abs(way[:, 1])
    across, down = _joined(lines[flat], 0), _joined(lines[~flat], 1)
    corners = [[_crossing(a, b) for b in down] for a in across]
    meets = np.array([[corner is not None for corner in row] for row in corners], bool)
    for i, k in itertools.permutations(range(len(across)), 2):
        both = np.flatnonzero(meets[i] & meets[k])
        for j, m in itertools.permutations(both, 2):
            quad = np.array([corners[i][j], corners[i][m], corners[k][m], corners[k][j]], float)
            wide, high = quad[1, 0] - quad[0, 0], quad[3, 1] - quad[0, 1]
            if wide > LEAST and high > LEAST and 0.5 < wide / high < 1.7:
                yield quad


def _joined(lines: Floats, axis: int) -> list[Floats]:
    """The longest of (n, 4) lines, those that go on in one another made one, x or y rising."""
    lines = np.where(lines[:, [axis]] < lines[:, [axis + 2]], lines, lines[:, [2, 3, 0, 1]])
    left = sorted((line for line in lines if _length(line) > PIECE), key=_length)
    whole: list[Floats] = []
    while left and len(whole) < MOST:
        line = left.pop()
        for _ in range(4):  # what was joined may reach further ones
            way = (line[2:] - line[:2]) / _length(line)
            apart = []
            for other in left:
                ends = other.reshape(2, 2) - line[:2]
                off = np.abs(ends @ [-way[1], way[0]]).max()
                along = ends @ way
                gap = max(along.min() - _length(line), -along.max())
                if off < ASIDE and gap < 0.4 * _length(line):
                    both = np.concatenate([line.reshape(2, 2), other.reshape(2, 2)])
                    both = both[np.argsort(both[:, axis])]
                    line = np.concatenate([both[0], both[-1]])
                else:
                    apart.append(other)
            if len(apart) == len(left):
                break
            left = apart
        if _length(line) >= LEAST:
            whole.append(line)
    return whole


def _length(line: Floats) -> float:
    return float(np.linalg.norm(line[2:] - line[:2]))


def _crossing(a: Floats, b: Floats) -> Floats | None:
    """Where two lines cross, if that is on both or near their ends."""
    p, r, q, s = a[:2], a[2:] - a[:2], b[:2], b[2:] - b[:2]
    area = r[0] * s[1] - r[1] * s[0]
    if abs(area) < 1e-9:
        return None
    t = ((q - p)[0] * s[1] - (q - p)[1] * s[0]) / area
    u = ((q - p)[0] * r[1] - (q - p)[1] * r[0]) / area
    near = all(-CORNER < v < 1.0 + CORNER for v in (t, u))
    return p + t * r if near else None
