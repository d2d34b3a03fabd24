"""OpenCV's hand-eye solvers on the same corners, judged by the same views that were left out.

Every solver gets what armsight has found: the corners, the lens, the right reading of the poses,
and of the two poses of a flat board the one that fits. What differs is the solver alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Floats, Pose, Poses
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.calibration.closed_form import mean_pose
from armsight.calibration.left_out import left_out_errors, on_plane
from armsight.calibration.problem import Sighting
from armsight.calibration.start import arm_for, planar_poses

Solver = Callable[[Poses, Poses], tuple[Pose, Pose]]
"""(n, 4, 4) A_i and C_i to X and Z with ``A_i Z = X C_i``."""


@dataclass(frozen=True)
class Peer:
    """One solver's errors in views that it has not seen.

    Attributes:
        name: of the solver.
        mm: mean distance on the board's plane between a corner's ray and the corner.
        px: rms distance in the picture.
        views: how many could be left out.
    """

    name: str
    mm: float
    px: float
    views: int


def compare(answer: Calibration, rig: int = 0) -> list[Peer]:
    """Ours and OpenCV's solvers, leave-one-out, best first.

    Raises:
        ValueError: fewer than four views of the camera are left.
    """
    problem = answer.problem
    lens = answer.main_lens(rig)
    views = [s for s in problem.sightings if s.lens == lens and not problem.views[s.view].free]
    if len(views) < 4:
        raise ValueError(f"only {len(views)} views to compare by")
    A = arm_for(problem, rig)[[s.view for s in views]]
    C = _boards(answer, views, A, rig)
    out = [_ours(answer, views, A, rig)]
    for name, solver in solvers().items():
        mm, square = [], []
        for k in range(len(views)):
            rest = np.arange(len(views)) != k
            try:
                X, Z = solver(A[rest], C[rest])
            except cv2.error:
                continue
            found = _errors(answer, views[k], A[k], X, Z)
            if found is not None:
                square.append(found[0])
                mm.append(found[1])
        if mm:
            px = float(np.sqrt(np.mean(np.concatenate(square))))
            out.append(Peer(name, float(np.mean(np.concatenate(mm))), px, len(mm)))
    return sorted(out, key=lambda p: p.mm)


def _ours(answer: Calibration, views: list[Sighting], A: Poses, rig: int) -> Peer:
    """Each view without it: by the solve of the rest, and the arm's error as they foresee it."""
    problem, field = answer.problem, answer.field
    if field is None:
        ours = left_out_errors(problem, answer.freedom, answer.solution, len(problem.used_views))
        return Peer("armsight", ours.mm, ours.px, len(problem.used_views))
    mm, square = [], []
    beside = problem.rigs[rig].mount == "base"
    for s, pose in zip(views, A):
        state, E = field.foreseen(s.view)
        arm = pose @ E if beside else se3.inverses(E[None])[0] @ pose
        found = _errors(answer, s, arm, state.T_mount_rig[rig], state.T_mount_board[s.board])
        if found is not None:
            square.append(found[0])
            mm.append(found[1])
    px = float(np.sqrt(np.mean(np.concatenate(square))))
    return Peer("armsight", float(np.mean(np.concatenate(mm))), px, len(mm))


def solvers() -> dict[str, Solver]:
    """OpenCV's, by name."""
    hand_eye = {
        "OpenCV Tsai": cv2.CALIB_HAND_EYE_TSAI,
        "OpenCV Park": cv2.CALIB_HAND_EYE_PARK,
        "OpenCV Horaud": cv2.CALIB_HAND_EYE_HORAUD,
        "OpenCV Andreff": cv2.CALIB_HAND_EYE_ANDREFF,
        "OpenCV Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
    }
    world = {
        "OpenCV Shah": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
        "OpenCV Li": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI,
    }
    out: dict[str, Solver] = {}
    for name, method in hand_eye.items():
        out[name] = _hand_eye(method)
    for name, method in world.items():
        out[name] = _robot_world(method)
    return out


def _hand_eye(method: int) -> Solver:
    def solve(A: Poses, C: Poses) -> tuple[Pose, Pose]:
        B = se3.inverses(A)
        R, t = cv2.calibrateHandEye(
            list(B[:, :3, :3]), list(B[:, :3, 3]), list(C[:, :3, :3]), list(C[:, :3, 3]),
            method=method,
        )  # fmt: skip
        X = _pose(R, t)
        return X, mean_pose(B @ X @ C)

    return solve


def _robot_world(method: int) -> Solver:
    def solve(A: Poses, C: Poses) -> tuple[Pose, Pose]:
        R_z, t_z, R_x, t_x = cv2.calibrateRobotWorldHandEye(
            list(C[:, :3, :3]), list(C[:, :3, 3]), list(A[:, :3, :3]), list(A[:, :3, 3]),
            method=method,
        )  # fmt: skip
        both = se3.inverses(np.array([_pose(R_x, t_x), _pose(R_z, t_z)]))
        return both[0], both[1]

    return solve


def _pose(R: Floats, t: Floats) -> Pose:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def _boards(answer: Calibration, views: list[Sighting], A: Poses, rig: int) -> Poses:
    """(n, 4, 4) ``T_camera_board`` of each view through the solved lens."""
    expected = se3.inverses(answer.camera_pose(rig)[None]) @ A @ answer.board_pose(views[0].board)
    out = []
    for s, near in zip(views, expected):
        found = planar_poses(
            answer.lens(s.lens), answer.problem.boards[s.board].points[s.corner], s.pixel
        )
        if found is None:
            out.append(near)
            continue
        gap = np.linalg.norm(se3.logs(se3.inverses(near[None]) @ found.T_lens_board)[:, 3:], axis=1)
        out.append(found.T_lens_board[int(np.argmin(gap))])
    return np.array(out)


def _errors(
    answer: Calibration, s: Sighting, A: Pose, X: Pose, Z: Pose
) -> tuple[Floats, Floats] | None:
    """Squared distances in the picture [px^2] and distances on the board's plane [mm]."""
    C = se3.inverses(X[None])[0] @ A @ Z
    lens = answer.lens(s.lens)
    p = answer.problem.boards[s.board].points[s.corner] @ C[:3, :3].T + C[:3, 3]
    if not np.isfinite(p).all() or p[:, 2].min() <= 0:
        return None
    d = lens.project(p) - s.pixel
    rays = np.column_stack([lens.normalise(s.pixel), np.ones(len(p))])
    return np.sum(d * d, axis=1), 1e3 * on_plane(rays, p)


def peer_lines(peers: list[Peer]) -> list[str]:
    """The table for a terminal."""
    out = ["views left out, one at a time      mm on the board      px    views"]
    out += [f"  {p.name:30s} {p.mm:14.3f} {p.px:11.3f} {p.views:7d}" for p in peers]
    return out
