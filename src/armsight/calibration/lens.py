"""Lenses from a board alone: Zhang's closed form, then all frames at once; second lens likewise.

Z. Zhang, "A flexible new technique for camera calibration", IEEE Trans. Pattern Analysis and
Machine Intelligence 22(11), 2000. The refinement is the room's own solver with every board free in
space, so that its covariance and its prior are those of every later solve (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Floats, Ints, Mask, Points
from armsight.calibration.covariance import Covariance, covariance
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.noise import solve_with_noise
from armsight.calibration.problem import (
    ArmView,
    BoardPlacement,
    Freedom,
    Lens,
    Priors,
    Problem,
    Rig,
    Sighting,
    lens_from_vector,
)
from armsight.calibration.solver import Solution, SolverOptions
from armsight.calibration.start import find_start
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera


def zhang(
    points: Sequence[Points], pixels: Sequence[Floats], width: int, height: int
) -> PinholeCamera | None:
    """Focal lengths and centre from homographies of a flat board; no distortion yet.

    Args:
        points: of each frame, (m, 3) corners on the board, z = 0 [m].
        pixels: of each frame, (m, 2) where they were seen [px].
        width: of the image [px].
        height: of the image [px].

    Returns:
        The lens, or None when the frames do not tell (all frontal, or fewer than two).
    """
    scale = 2.0 / max(width, height)
    middle = 0.5 * np.array([width - 1, height - 1])
    rows = []
    for X, p in zip(points, pixels):
        if len(X) < 4:
            continue
        found: Floats | None = cv2.findHomography(X[:, :2], (p - middle) * scale, 0)[0]  # type: ignore[assignment]
        if found is None:
            continue
        M: Floats = np.asarray(found / np.linalg.norm(found), np.float64)

        def row(i: int, j: int, H: Floats = M) -> Floats:
            # B is diagonal but for the centre, which is taken as the middle of the image.
            return np.array([H[0, i] * H[0, j] + 0.0, H[1, i] * H[1, j], H[2, i] * H[2, j]])

        rows += [row(0, 1), row(0, 0) - row(1, 1)]
    if len(rows) < 4:
        return None
    b = np.linalg.svd(np.array(rows))[2][-1]
    if b[2] == 0 or b[0] / b[2] <= 0 or b[1] / b[2] <= 0:
        return None
    fx, fy = np.sqrt(b[2] / b[0]) / scale, np.sqrt(b[2] / b[1]) / scale
    if not (0.2 * width < fx < 20 * width and 0.5 < fx / fy < 2.0):
        return None
    f = float(np.sqrt(fx * fy))
    return PinholeCamera(width, height, f, f, float(middle[0]), float(middle[1]))


@dataclass(frozen=True)
class LensCalibration:
    """A lens from its frames.

    Attributes:
        camera: the answer.
        covariance: of its nine numbers (9, 9).
        information: (9, 9) what these frames tell, board poses eliminated: the prior of later
            solves.
        rms_px: distance of corners [px].
        frames: used.
        solution: of all unknowns.
    """

    camera: PinholeCamera
    covariance: Floats
    information: Floats
    rms_px: float
    frames: int
    solution: Solution


def lens_problem(
    lenses: Sequence[Lens],
    board: Points,
    frames: Sequence[tuple[int, int, Ints, Floats]],
    sigma: float = 0.15,
) -> Problem:
    """A problem of lens frames alone: every board hangs freely in space.

    Args:
        lenses: of one rig (main first).
        board: (k, 3) corners [m].
        frames: (view, lens, corner indices, pixels); two lenses that saw the board at once share
            the view.
        sigma: of a corner's coordinate [px].
    """
    count = max((v for v, _, _, _ in frames), default=-1) + 1
    return Problem(
        (Rig("camera"),),
        tuple(lenses),
        (BoardPlacement("board", board),),
        tuple(ArmView(np.eye(4), free=True) for _ in range(count)),
        tuple(Sighting(v, c, 0, k, p, sigma) for v, c, k, p in frames),
    )


def calibrate_lens(
    board: Points,
    frames: Sequence[tuple[Ints, Floats]],
    width: int,
    height: int,
    sheet: PinholeCamera | None = None,
    rng: np.random.Generator | None = None,
    priors: Priors | None = None,
) -> LensCalibration:
    """One lens from frames of a board.

    Args:
        board: (k, 3) corners [m].
        frames: (corner indices, pixels) of each.
        width: of the image [px].
        height: of the image [px].
        sheet: what the maker says; found by Zhang's closed form without it.
        rng: for the start's random samples.
        priors: about the board.

    Raises:
        CalibrationError: too few frames, all alike, or no board's.
    """
    if len(frames) < 3 and sheet is None:
        raise CalibrationError(
            f"lens: {len(frames)} frames of the board are too few; take at least five with the "
            "board tilted by 20-40 deg in different directions"
        )
    prior = None
    enough = [(k, p) for k, p in frames if not _in_line(board[k])]
    if not enough:
        raise CalibrationError(
            f"lens: none of the {len(frames)} frames has four corners of the board that are not on "
            "one line; show the whole board"
        )
    if sheet is None:
        points, pixels = [board[k] for k, _ in enough], [p for _, p in enough]
        sheet = zhang(points, pixels, width, height)
        if sheet is None:  # a few corners that are wrong spoil it
            flat = [_flat(X, p) for X, p in zip(points, pixels)]
            points = [X[kept] for X, kept in zip(points, flat)]
            sheet = zhang(points, [p[kept] for p, kept in zip(pixels, flat)], width, height)
        if sheet is None:
            raise CalibrationError(f"lens: the frames do not tell the focal length: {_why(flat)}")
        prior = sheet_prior(sheet, focal=0.5, center=0.1, distortion=1.0)
    lens = Lens("lens", 0, sheet, prior=sheet_prior(sheet) if prior is None else prior)
    problem = lens_problem([lens], board, [(i, 0, k, p) for i, (k, p) in enumerate(frames)])
    start = find_start(problem, rng or np.random.default_rng(0))
    if not start.problem.sightings:
        raise CalibrationError(
            "lens: in no frame do the corners lie where a board's can; "
            "check its kind, its size and the order of its corners"
        )
    freedom = Freedom(lens=True, shape=True, white=None)
    solution, _ = solve_with_noise(start.problem, freedom, priors, SolverOptions())
    return summary(solution, 0)


FLAT = 0.03
"""A corner is off a flat board's picture by more than a lens bends it: share of that picture."""


def _in_line(X: Points) -> bool:
    """Whether (m, 3) corners are fewer than four, or on one line."""
    if len(X) < 4:
        return True
    spread = np.linalg.svd(X - X.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 0.05 * spread[0])


def _flat(X: Points, p: Floats) -> Mask:
    """(m,) which corners lie as those of a flat board do; none where half of them do not."""
    found: Floats | None = cv2.findHomography(X[:, :2], p, cv2.LMEDS)[0]  # type: ignore[assignment]
    if found is None:
        return np.zeros(len(X), bool)
    seen = np.c_[X[:, :2], np.ones(len(X))] @ np.asarray(found).T
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - p, axis=1)
    kept = off < FLAT * float(np.median(np.ptp(p, axis=0)))
    return kept if 2 * int(kept.sum()) > len(X) else np.zeros(len(X), bool)


def _why(flat: Sequence[Mask]) -> str:
    """Why no focal length was found, by which corners of each frame are as on a flat board."""
    bent = sum(not kept.any() for kept in flat)
    if len(flat) - bent < 2:
        return (
            f"in {bent} of {len(flat)} frames the corners do not lie as those of a flat board do; "
            "check its kind and size, and the order of its corners"
        )
    return "all show the board facing the camera; tilt it by 20-40 deg in different directions" + (
        f" (and in {bent} of {len(flat)} it is not flat)" if bent else ""
    )


def summary(solution: Solution, lens: int) -> LensCalibration:
    """What a solution says of one lens."""
    cov: Covariance = covariance(solution)
    block = cov.block(solution.model.lens_slice(lens))
    camera = solution.model.problem.lenses[lens].camera
    prior = solution.model.problem.lenses[lens].prior
    information: Floats = np.asarray(np.linalg.pinv(block, rcond=1e-14, hermitian=True), np.float64)
    if prior is not None:
        # What the frames told beyond the sheet; the sheet is added again by whoever uses this.
        information = information - prior
        values, vectors = np.linalg.eigh(0.5 * (information + information.T))
        information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return LensCalibration(
        lens_from_vector(solution.state.lens[lens], camera.width, camera.height),
        block,
        information,
        solution.rms_px(lens),
        len({s.view for s in solution.model.problem.sightings if s.lens == lens}),
        solution,
    )
