"""How well one reading of the poses fits the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Poses
from armsight.calibration import se3
from armsight.calibration.problem import Problem, Sighting
from armsight.calibration.start import HandEyeStart, PlanarPose, hand_eye_start
from armsight.calibration.start import planar_poses as planar

BETTER = 3.0
"""Another reading must fit this many times better to be named."""


Item = tuple[int, PlanarPose, Sighting]


@dataclass(frozen=True)
class Fit:
    """How well a reading fits: the start it gives, its median error, how angles agree."""

    start: HandEyeStart
    median_px: float
    angle_gap: float


def fit_reading(A: Poses, items: list[Item], problem: Problem, seed: int) -> Fit | None:
    """Fit camera and board to arm poses as read."""
    if len(items) < 3 or not np.isfinite(A).all():
        return None
    s = items[0][2]
    lens, points = problem.lenses[s.lens], problem.boards[s.board].points
    start = hand_eye_start(A, items, points, lens.camera, np.random.default_rng(seed))
    if start is None:
        return None
    views = [v for v, _, _ in items]
    C = se3.inverses(start.X[None]) @ A[views] @ start.Z
    errors = []
    for k, (_, _, s) in enumerate(items):
        p = points[s.corner] @ C[k, :3, :3].T + C[k, :3, 3]
        d = lens.camera.project(p) - s.pixel
        errors.append(np.sqrt(np.mean(np.sum(d * d, axis=1))) if np.isfinite(d).all() else 1e6)
    return Fit(start, float(np.median(errors)), angle_gap(A[views], items))


def angle_gap(A: Poses, items: list[Item]) -> float:
    """Median difference of the angles by which arm and board turn between views [rad]."""
    i, j = np.triu_indices(len(A), 1)
    a = np.linalg.norm(se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:], axis=1)
    gaps = []
    for x in (0, -1):
        C = np.array([p.T_lens_board[x] for _, p, _ in items])
        c = np.linalg.norm(se3.logs(se3.inverses(C[i]) @ C[j])[:, 3:], axis=1)
        gaps.append(np.abs(a - c))
    return float(np.median(np.minimum(*gaps)))


def items_of(problem: Problem, rig: int) -> list[Item]:
    """Board poses in a rig's most used lens, arm views only."""
    count: dict[int, int] = {}
    for s in problem.sightings:
        if problem.lenses[s.lens].rig == rig and not problem.views[s.view].free:
            count[s.lens] = count.get(s.lens, 0) + 1
    if not count:
        return []
    lens = max(count, key=lambda k: count[k])
    out: list[Item] = []
    for s in problem.sightings:
        if s.lens == lens and not problem.views[s.view].free:
            p = planar(
                problem.lenses[lens].camera, problem.boards[s.board].points[s.corner], s.pixel
            )
            if p is not None:
                out.append((s.view, p, s))
    return out
