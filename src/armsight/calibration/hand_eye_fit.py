"""How well arm poses and board poses belong together, for many readings of the poses at once.

For each reading: rotations by Shah's Kronecker product, positions and their scale by least squares,
both with weights that forget views which do not fit, and each view's choice among the poses that a
flat board may have. The scale is left free: a wrong unit shows as a factor, not as a misfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, Poses
from armsight.calibration import se3
from armsight.calibration.boards import Turn


@dataclass(frozen=True)
class SeenBoards:
    """The poses that the board may have in each picture.

    Attributes:
        options: (n, o, 4, 4) ``T_camera_board``: the two of a flat board, and those turned by half
            a turn where the board looks alike from two sides.
        radius: rms distance of the corners from their middle [m].
        focal: of the lens [px].
        middle: (3,) of the corners, in the board's frame [m].
    """

    options: Poses
    radius: float
    focal: float
    middle: Floats

    def only(self, index: Ints) -> SeenBoards:
        """Some pictures only."""
        return SeenBoards(self.options[index], self.radius, self.focal, self.middle)


@dataclass(frozen=True)
class HandEyeFit:
    """How one reading fits.

    Attributes:
        px: (n,) rough distance of the corners from where the fit puts them [px].
        option: (n,) which pose of the board each view takes.
        scale: metres in a unit of the arm's positions; scale_sigma: share of it that is unsure.
        X, Z: (4, 4) camera and board in their mounts.
        turn: (n,) misfit of the rotations [rad].
    """

    px: Floats
    option: Ints
    scale: float
    scale_sigma: float
    X: Floats
    Z: Floats
    turn: Floats

    @property
    def median_px(self) -> float:
        """Of the views [px]."""
        return float(np.median(self.px))


def angle_gaps(R: Floats, boards: SeenBoards, pairs: int = 400) -> Floats:
    """(b,) median difference of the angles by which arm and board turn between views [rad].

    Args:
        R: (b, n, 3, 3) rotations of the arm by b readings.
        boards: of the same n views.
        pairs: of views, at most.
    """
    n = R.shape[1]
    i, j = np.triu_indices(n, 1)
    if len(i) > pairs:
        pick = np.linspace(0, len(i) - 1, pairs).astype(int)
        i, j = i[pick], j[pick]
    arm = _angles(R[:, i], R[:, j])
    C = boards.options[..., :3, :3]
    o = C.shape[1]
    gaps = []
    for a in range(o):
        for b in range(o):
            # The two poses of a flat board are both near the truth only when they are alike:
            # pairs of the same kind are enough; a turned board is another matter.
            if a == b or o > 2:
                gaps.append(np.abs(arm - _angles(C[i, a], C[j, b])))
    return np.asarray(np.median(np.minimum.reduce(gaps), axis=1), np.float64)


def _angles(A: Floats, B: Floats) -> Floats:
    trace = np.einsum("...ij,...ij->...", A, B)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1), -1, 1)), np.float64)


def fit(A: Poses, boards: SeenBoards, rounds: int = 6) -> HandEyeFit:
    """Fit ``A_i Z = X C_i`` with the scale of A's positions free.

    Args:
        A: (n, 4, 4) arm poses as read (inverted for a camera on the arm), any unit of length.
        boards: of the same views.
        rounds: of choosing options and weights.
    """
    R_A, t_A = A[:, :3, :3], A[:, :3, 3]
    C = boards.options
    o = C.shape[1]
    best: HandEyeFit | None = None
    for seed in _seeds(R_A, C):
        found = _fit_from(R_A, t_A, boards, seed, rounds)
        if best is None or found.median_px < best.median_px:
            best = found
        if o <= 2:
            break
    assert best is not None
    return best


def _seeds(R_A: Floats, C: Poses) -> list[Ints]:
    """First choices of option: the best fitting; where boards may be turned, grown from a view."""
    n, o = C.shape[:2]
    if o <= 2:
        return [np.zeros(n, int)]
    out = []
    for first in dict.fromkeys((0, n // 2, n - 1)):
        arm = _angles(np.broadcast_to(R_A[first], R_A.shape), R_A)
        board = _angles(np.broadcast_to(C[first, 0, :3, :3], C[..., :3, :3].shape), C[..., :3, :3])
        out.append(np.argmin(np.abs(board - arm[:, None]), axis=1))
    return out


def _fit_from(
    R_A: Floats, t_A: Floats, boards: SeenBoards, option: Ints, rounds: int
) -> HandEyeFit:
    C = boards.options
    n = len(C)
    index = np.arange(n)
    weight = np.ones(n)
    r, f, middle = boards.radius, boards.focal, boards.middle
    for turn in range(rounds):
        c = C[index, option]
        R_X, R_Z = _rotations(R_A, c[:, :3, :3], weight)
        # Every option against the fit: a flat board's other pose, or the turned one.
        expected = np.swapaxes(R_X, 0, 1) @ R_A @ R_Z
        away = _angles(np.broadcast_to(expected[:, None], C[..., :3, :3].shape), C[..., :3, :3])
        new = np.argmin(away, axis=1)
        c = C[index, new]
        miss = away[index, new]
        t_C = c[:, :3, :3] @ middle + c[:, :3, 3]
        t_X, t_Z, scale, sigma, left = _positions(R_A, t_A, t_C, R_X, weight)
        z = np.maximum(t_C[:, 2], 1e-6)
        local = left @ R_X  # in the camera's axes
        px = (f / z) * np.sqrt(
            (miss * r) ** 2 + local[:, 0] ** 2 + local[:, 1] ** 2 + (local[:, 2] * r / z) ** 2
        )
        limit = max(float(np.median(px)), 1e-9)
        weight = 1.0 / (1.0 + (px / (2.0 * limit)) ** 2) ** 2
        if turn and np.array_equal(new, option):
            break
        option = new
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3] = R_X, t_X
    Z[:3, :3], Z[:3, 3] = R_Z, t_Z - R_Z @ middle
    return HandEyeFit(px, option, scale, sigma, X, Z, miss)


def _rotations(R_A: Floats, R_C: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Shah's rotations (see ``closed_form.shah``), weighted."""
    K = np.einsum("n,nij,nkl->ikjl", weight, R_A, R_C, optimize=True).reshape(9, 9)
    U, _, V_t = np.linalg.svd(K)
    Z, X = V_t[0].reshape(3, 3), U[:, 0].reshape(3, 3)
    sign = np.sign(np.linalg.det(Z)) or 1.0
    return _nearest(sign * X), _nearest(sign * Z)


def _nearest(M: Floats) -> Floats:
    U, _, V_t = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V_t)) or 1.0]) @ V_t)


def _positions(
    R_A: Floats, t_A: Floats, t_C: Floats, R_X: Floats, weight: Floats
) -> tuple[Floats, Floats, float, float, Floats]:
    """``R_A t_Z + s t_A = R_X t_C + t_X``: t_X, t_Z, s, its relative sigma, what is left (n, 3)."""
    n = len(R_A)
    rows = np.zeros((n, 3, 7))
    rows[:, :, :3] = R_A
    rows[:, :, 3:6] = -np.eye(3)
    rows[:, :, 6] = t_A
    right = t_C @ R_X.T
    w = np.sqrt(weight)[:, None]
    a, b = (rows * w[..., None]).reshape(-1, 7), (right * w).reshape(-1)
    size = np.maximum(np.linalg.norm(a, axis=0), 1e-12)
    a = a / size
    x, *_ = np.linalg.lstsq(a, b, rcond=1e-9)
    left = (b - a @ x).reshape(n, 3) / w
    noise = float(np.median(np.linalg.norm(left, axis=1)))
    inverse = np.linalg.pinv(a.T @ a, rcond=1e-12)
    sigma = noise * float(np.sqrt(inverse[6, 6])) / max(abs(float(x[6])), 1e-12)
    x = x / size
    return x[3:6], x[:3], float(x[6]), sigma, left


def board_options(
    T: Sequence[Poses], turns: Sequence[Turn], points: Floats, focal: float
) -> SeenBoards:
    """The poses that boards may have, from the one or two of each flat board.

    Args:
        T: of each picture, (1 or 2, 4, 4) ``T_camera_board``, the better first.
        turns: other ways to read the board.
        points: (k, 3) its corners [m].
        focal: of the lens [px].
    """
    two = np.array([[p[0], p[-1]] for p in T])
    parts = [two]
    for turn in turns:
        # Corner k is taken for turn.corner[k]: the board's frame moves by the opposite turn.
        parts.append(two @ se3.inverses(_onto(points, points[turn.corner])[None])[0])
    middle = 0.5 * (points.max(0) + points.min(0))
    radius = float(np.sqrt(np.mean(np.sum((points - points.mean(0)) ** 2, axis=1))))
    return SeenBoards(np.concatenate(parts, axis=1), radius, focal, middle)


def _onto(a: Floats, b: Floats) -> Floats:
    """(4, 4) turn about the board's normal that brings (k, 3) points a onto b."""
    x, y = a[:, :2] - a[:, :2].mean(0), b[:, :2] - b[:, :2].mean(0)
    angle = np.arctan2((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum(), (x * y).sum())
    S = np.eye(4)
    S[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    S[:3, 3] = b.mean(0) - S[:3, :3] @ a.mean(0)
    return S
