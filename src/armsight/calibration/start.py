"""Start values: board poses in a lens by planar PnP, then cameras and board on the arm.

A small board seen nearly frontally has two poses that explain its corners almost equally well
(the Necker cube). Both are kept; the arm decides. Mis-seen boards are left out of the start by
random sampling over views. The best camera's board-on-flange is carried to the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from armsight.arrays import Floats, Points, Pose, Poses
from armsight.calibration import se3
from armsight.calibration.closed_form import mean_pose, park, shah
from armsight.calibration.problem import Lens, Problem, Sighting
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class PlanarPose:
    """The one or two poses of a flat board in a lens.

    Attributes:
        T_lens_board: (1 or 2, 4, 4), the better fitting first.
        rms_px: (1 or 2,) how well each fits [px].
    """

    T_lens_board: Poses
    rms_px: Floats


def planar_poses(camera: PinholeCamera, points: Points, pixels: Floats) -> PlanarPose | None:
    """Both poses of a flat board from its corners; None when they do not give any.

    Args:
        camera: the lens.
        points: (m, 3) corners in the board's frame, z = 0 [m].
        pixels: (m, 2) where they were seen [px].
    """
    if len(points) < 4:
        return None
    flat = points[:, :2] - points[:, :2].mean(0)
    if np.linalg.svd(flat, compute_uv=False)[1] < 1e-3 * np.linalg.norm(flat):
        return None  # all in one row
    ideal = camera.normalise(pixels)
    try:
        n, rvecs, tvecs, _ = cv2.solvePnPGeneric(
            np.ascontiguousarray(points, float),
            np.ascontiguousarray(ideal),
            np.eye(3),
            None,
            flags=cv2.SOLVEPNP_IPPE,
        )
    except cv2.error:
        return None
    found: list[tuple[float, Pose]] = []
    for rvec, tvec in zip(rvecs[:n], tvecs[:n]):
        rvec, tvec = cv2.solvePnPRefineLM(
            np.ascontiguousarray(points, float),
            np.ascontiguousarray(ideal),
            np.eye(3),
            None,
            rvec.copy(),
            tvec.copy(),
        )
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(rvec)[0]
        T[:3, 3] = tvec.ravel()
        if not np.isfinite(T).all() or T[2, 3] <= 0:
            continue
        d = camera.project(points @ T[:3, :3].T + T[:3, 3]) - pixels
        rms = float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
        if np.isfinite(rms):
            found.append((rms, T))
    if not found:
        return None
    found.sort(key=lambda item: item[0])
    if len(found) == 2 and np.allclose(found[0][1], found[1][1], atol=1e-5):
        found = found[:1]
    return PlanarPose(np.array([T for _, T in found]), np.array([r for r, _ in found]))


@dataclass(frozen=True)
class HandEyeStart:
    """Where a camera and a board roughly are.

    Attributes:
        X: camera in its mount; Z: board in its mount.
        good: views that fit.
        rms_px: of those views [px].
        method: which closed form gave it.
    """

    X: Pose
    Z: Pose
    good: tuple[int, ...]
    rms_px: float
    method: str


def hand_eye_start(
    arm: Poses,
    sightings: list[tuple[int, PlanarPose, Sighting]],
    points: Points,
    camera: PinholeCamera,
    rng: np.random.Generator,
    tolerance_px: float | None = None,
) -> HandEyeStart | None:
    """X and Z with ``A_i Z = X C_i`` that fit most views in pixels.

    Args:
        arm: (V, 4, 4) A_i by view.
        sightings: (view, poses of the board in the lens, what was seen).
        points: (k, 3) corners of the board [m].
        camera: the lens.
        rng: draws the samples.
        tolerance_px: a view fits within this; chosen from the image size when None.

    Returns:
        The best start, or None with fewer than three views.
    """
    if len(sightings) < 3:
        return None
    # The arm and the lens may be percents off here: generous, in proportion to the focal length.
    tolerance = tolerance_px or max(6.0, 0.03 * camera.fx)
    views = np.array([view for view, _, _ in sightings])
    A = arm[views]
    first = np.array([p.T_lens_board[0] for _, p, _ in sightings])
    second = np.array([p.T_lens_board[-1] for _, p, _ in sightings])

    def errors(X: Pose, Z: Pose) -> Floats:
        C = se3.inverses(X[None]) @ A @ Z
        out = np.empty(len(C))
        for k, (_, _, s) in enumerate(sightings):
            p = points[s.corner] @ C[k, :3, :3].T + C[k, :3, 3]
            d = camera.project(p) - s.pixel
            out[k] = np.sqrt(np.mean(np.sum(d * d, axis=1))) if np.isfinite(d).all() else 1e6
        return out

    best: tuple[float, Pose, Pose, str] | None = None

    def consider(X: Pose, Z: Pose, method: str) -> None:
        nonlocal best
        if not (np.isfinite(X).all() and np.isfinite(Z).all()):
            return
        cost = float(np.minimum(errors(X, Z), tolerance).sum())
        if best is None or cost < best[0]:
            best = (cost, X, Z, method)

    solvers: tuple[tuple[str, Callable[[Poses, Poses], tuple[Pose, Pose]]], ...] = (
        ("Shah", shah),
        ("Park", park),
    )
    for method, solver in solvers:
        consider(*solver(A, first), method)
    n = len(A)
    size = min(n, 4)
    for _ in range(60 if n > 3 else 10):
        pick = rng.choice(n, size, replace=False)
        flip = rng.random(size) < 0.3
        C = np.where(flip[:, None, None], second[pick], first[pick])
        if not _angles_agree(A[pick], C):
            continue
        consider(*shah(A[pick], C), "Shah")
    if best is None:
        return None
    for _ in range(3):  # choose between the two poses by the arm, drop what does not fit, repeat
        _, X, Z, _ = best
        predicted = se3.inverses(X[None]) @ A @ Z
        gap1 = np.linalg.norm(se3.logs(se3.inverses(predicted) @ first)[:, 3:], axis=1)
        gap2 = np.linalg.norm(se3.logs(se3.inverses(predicted) @ second)[:, 3:], axis=1)
        C = np.where((gap2 < gap1)[:, None, None], second, first)
        e = errors(X, Z)
        good = e <= max(tolerance, 2.0 * float(np.median(e)))
        if good.sum() < 3:
            break
        for method, solver in solvers:
            consider(*solver(A[good], C[good]), method)
    _, X, Z, method = best
    e = errors(X, Z)
    good = e <= max(tolerance, 3.0 * float(np.median(e)))
    return HandEyeStart(
        X, Z, tuple(int(v) for v in views[good]), float(np.sqrt(np.mean(e[good] ** 2))), method
    )


def _angles_agree(A: Poses, C: Poses) -> bool:
    """Whether arm and board turn by the same angles between the views (to 6 deg)."""
    i, j = np.triu_indices(len(A), 1)
    a = np.linalg.norm(se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:], axis=1)
    c = np.linalg.norm(se3.logs(se3.inverses(C[i]) @ C[j])[:, 3:], axis=1)
    return bool(np.all(np.abs(a - c) < np.deg2rad(6)))


def arm_for(problem: Problem, rig: int) -> Poses:
    """(V, 4, 4) the A_i of a rig: the flange, or its inverse for a camera that the arm carries."""
    T = np.array([v.T_base_flange for v in problem.views])
    return T if problem.rigs[rig].mount == "base" else se3.inverses(T)


@dataclass(frozen=True)
class Start:
    """A problem with start values, and what was found on the way.

    Attributes:
        problem: with the start values filled in, and only the sightings that fit.
        rejected: (sighting, reason) of those that do not.
        hand_eye: best start of each rig, None where it was carried over or impossible.
    """

    problem: Problem
    rejected: tuple[tuple[Sighting, str], ...]
    hand_eye: tuple[HandEyeStart | None, ...]


def find_start(problem: Problem, rng: np.random.Generator) -> Start:
    """Fill in where cameras, boards, second lenses and free boards roughly are.

    Raises:
        CalibrationError: no camera has enough to start from.
    """
    rejected: list[tuple[Sighting, str]] = []
    kept: list[tuple[Sighting, PlanarPose]] = []
    for s in problem.sightings:
        poses = planar_poses(
            problem.lenses[s.lens].camera, problem.boards[s.board].points[s.corner], s.pixel
        )
        if poses is None:
            rejected.append((s, "too few corners, or all in one row"))
        else:
            kept.append((s, poses))
    problem = replace(problem, sightings=tuple(s for s, _ in kept))
    problem = _second_lenses(problem, kept)

    rigs, boards = list(problem.rigs), list(problem.boards)
    starts: list[HandEyeStart | None] = [None] * len(rigs)
    usable: dict[tuple[int, int], list[tuple[int, PlanarPose, Sighting]]] = {}
    for s, poses in kept:
        lens = problem.lenses[s.lens]
        if problem.views[s.view].free:
            continue
        if problem.rigs[lens.rig].mount == problem.boards[s.board].mount:
            continue
        usable.setdefault((lens.rig, s.lens), []).append((s.view, poses, s))

    # Each rig by the lens that saw most; best rig first.
    candidates: list[tuple[float, int, int, HandEyeStart]] = []
    for (rig, lens_index), items in usable.items():
        board = items[0][2].board
        items = [item for item in items if item[2].board == board]
        lens = problem.lenses[lens_index]
        start = hand_eye_start(arm_for(problem, rig), items, boards[board].points, lens.camera, rng)
        if start is None:
            continue
        X = start.X @ se3.inverses(lens.T_rig_lens[None])[0]
        candidates.append(
            (-len(start.good) + start.rms_px / lens.camera.fx, rig, board, replace(start, X=X))
        )
    if not candidates and usable:
        raise CalibrationError(
            "calibration start: every camera saw the board in fewer than three views; "
            "take at least three views a camera with the board turned about different axes"
        )
    candidates.sort(key=lambda item: item[0])
    known_boards: set[int] = set()
    for _, rig, board, start in candidates:
        if starts[rig] is not None:
            continue
        if board in known_boards:
            carried = _carry(problem, rig, board, boards[board].T_mount_board, usable)
            if carried is not None and carried.rms_px <= 1.5 * start.rms_px + 2.0:
                start = carried
        else:
            boards[board] = replace(boards[board], T_mount_board=start.Z)
            known_boards.add(board)
        starts[rig] = start
        rigs[rig] = replace(rigs[rig], T_mount_rig=start.X)
    for rig in range(len(rigs)):
        if starts[rig] is None and any(r == rig for r, _ in usable):
            for board in known_boards:
                carried = _carry(problem, rig, board, boards[board].T_mount_board, usable)
                if carried is not None:
                    starts[rig] = carried
                    rigs[rig] = replace(rigs[rig], T_mount_rig=carried.X)
    problem = replace(problem, rigs=tuple(rigs), boards=tuple(boards))
    problem = _free_boards(problem, kept)
    problem, late = _drop_misfits(problem, starts)
    return Start(problem, (*rejected, *late), tuple(starts))


def _carry(
    problem: Problem,
    rig: int,
    board: int,
    Z: Pose,
    usable: dict[tuple[int, int], list[tuple[int, PlanarPose, Sighting]]],
) -> HandEyeStart | None:
    """A rig's pose from a board whose place on its mount is known from another camera."""
    A = arm_for(problem, rig)
    found: list[Pose] = []
    items: list[tuple[int, int, Sighting]] = []
    for (r, lens_index), sightings in usable.items():
        if r != rig:
            continue
        T_lens_rig = se3.inverses(problem.lenses[lens_index].T_rig_lens[None])[0]
        for view, poses, s in sightings:
            if s.board != board:
                continue
            for C in poses.T_lens_board:
                found.append(A[view] @ Z @ se3.inverses(C[None])[0] @ T_lens_rig)
                items.append((view, lens_index, s))
    if not found:
        return None
    T = np.array(found)
    gaps = np.linalg.norm(
        se3.logs((se3.inverses(T)[:, None] @ T[None]).reshape(-1, 4, 4)).reshape(len(T), len(T), 6)
        * [5.0, 5.0, 5.0, 1.0, 1.0, 1.0],
        axis=-1,
    )
    centre = int(np.argmin(np.median(gaps, axis=1)))
    near = gaps[centre] <= max(3 * float(np.median(gaps[centre])), 0.02)
    X = mean_pose(T[near])
    errors = []
    for view, lens_index, s in {(v, li, id(s)): (v, li, s) for v, li, s in items}.values():
        lens = problem.lenses[lens_index]
        C = se3.inverses((X @ lens.T_rig_lens)[None])[0] @ A[view] @ Z
        p = problem.boards[board].points[s.corner] @ C[:3, :3].T + C[:3, 3]
        d = lens.camera.project(p) - s.pixel
        errors.append(np.sqrt(np.mean(np.sum(d * d, axis=1))) if np.isfinite(d).all() else 1e6)
    e = np.array(errors)
    good = e <= max(3 * float(np.median(e)), 6.0)
    return HandEyeStart(X, Z, (), float(np.sqrt(np.mean(e[good] ** 2))), "carried over")


def _second_lenses(problem: Problem, kept: list[tuple[Sighting, PlanarPose]]) -> Problem:
    """Pose of each free second lens in its rig, from boards that both lenses see at once."""
    lenses = list(problem.lenses)
    for index, lens in enumerate(lenses):
        if not lens.offset_free:
            continue
        main = next(i for i, other in enumerate(lenses) if other.rig == lens.rig)
        seen = {(s.view, s.board): p for s, p in kept if s.lens == main}
        found = []
        for s, p in kept:
            if s.lens == index and (s.view, s.board) in seen:
                for a in seen[s.view, s.board].T_lens_board:
                    for b in p.T_lens_board:
                        found.append(a @ se3.inverses(b[None])[0])
        if not found:
            continue
        T = np.array(found)
        angle = np.linalg.norm(se3.logs(se3.inverses(lens.T_rig_lens[None]) @ T)[:, 3:], axis=1)
        near = T[angle <= np.quantile(angle, 0.3) + 0.02]
        out = mean_pose(near)
        out[:3, 3] = np.median(near[:, :3, 3], axis=0)
        lenses[index] = replace(lens, T_rig_lens=out)
    return replace(problem, lenses=tuple(lenses))


def _free_boards(problem: Problem, kept: list[tuple[Sighting, PlanarPose]]) -> Problem:
    """Start pose of each freely held board, in the mount frame of the rig that sees it."""
    views = list(problem.views)
    best: dict[int, tuple[int, Pose]] = {}
    for s, p in kept:
        if not views[s.view].free or len(s.corner) <= best.get(s.view, (0, np.eye(4)))[0]:
            continue
        lens = problem.lenses[s.lens]
        rig = problem.rigs[lens.rig]
        best[s.view] = (len(s.corner), rig.T_mount_rig @ lens.T_rig_lens @ p.T_lens_board[0])
    for view, (_, T) in best.items():
        views[view] = replace(views[view], T_base_flange=T)
    return replace(problem, views=tuple(views))


def _drop_misfits(
    problem: Problem, starts: list[HandEyeStart | None]
) -> tuple[Problem, list[tuple[Sighting, str]]]:
    """Leave out sightings far from where the start expects them, and cameras without a start."""
    kept: list[Sighting] = []
    rejected: list[tuple[Sighting, str]] = []
    T = {rig: arm_for(problem, rig) for rig in range(len(problem.rigs))}
    errors: list[float] = []
    for s in problem.sightings:
        lens = problem.lenses[s.lens]
        if problem.views[s.view].free:
            errors.append(0.0)
            continue
        rig, board = problem.rigs[lens.rig], problem.boards[s.board]
        A = T[lens.rig][s.view] if rig.mount != board.mount else np.eye(4)
        C = se3.inverses((rig.T_mount_rig @ lens.T_rig_lens)[None])[0] @ A @ board.T_mount_board
        d = lens.camera.project(board.points[s.corner] @ C[:3, :3].T + C[:3, 3]) - s.pixel
        errors.append(
            float(np.sqrt(np.mean(np.sum(d * d, axis=1)))) if np.isfinite(d).all() else np.inf
        )
    e = np.array(errors)
    for k, s in enumerate(problem.sightings):
        lens = problem.lenses[s.lens]
        if problem.views[s.view].free:
            kept.append(s)
            continue
        if starts[lens.rig] is None:
            rejected.append((s, "its camera has fewer than three views and no start"))
            continue
        mine = [i for i, t in enumerate(problem.sightings) if t.lens == s.lens]
        limit = max(0.03 * lens.camera.fx, 4 * float(np.median(e[mine])))
        limit += _bend(lens, s.pixel)
        if e[k] <= limit:
            kept.append(s)
        else:
            rejected.append(
                (s, f"{e[k]:.0f} px from where the other views put it (limit {limit:.0f} px)")
            )
    return replace(problem, sightings=tuple(kept)), rejected


def _bend(lens: Lens, pixel: Floats) -> float:
    """How far off a board may be because the lens's distortion is not known yet [px]: 3 sigma."""
    if lens.prior is None or lens.keep:
        return 0.0
    r = float(np.linalg.norm(lens.camera.normalise(pixel), axis=1).mean())
    sigma = 1 / np.sqrt(np.maximum(np.diagonal(lens.prior)[[4, 5, 8]], 1e-12))
    bend = float(np.linalg.norm(sigma * np.array([r**3, r**5, r**7])))
    return float(lens.camera.fx * min(3.0 * bend, 0.15))
