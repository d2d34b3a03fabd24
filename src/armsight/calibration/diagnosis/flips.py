"""Boards read turned by 180 degrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Poses
from armsight.calibration import se3
from armsight.calibration.diagnosis.reading import BETTER, Fit, Item, angle_gap
from armsight.calibration.findings import Finding
from armsight.calibration.problem import Problem
from armsight.calibration.start import planar_poses as planar


def turned_boards(
    problem: Problem, items: list[Item], fit: Fit, A: Poses
) -> tuple[Finding, list[Item]] | None:
    """Items with boards turned by 180 degrees where that fits better."""
    lens = problem.lenses[items[0][2].lens].camera
    points = problem.boards[items[0][2].board].points
    if len(points) < 4:
        return None
    turned = []
    for v, _, s in items:
        whole = len(s.corner) == len(points)
        if not whole:
            return None
        other = replace(s, pixel=s.pixel[::-1])
        p = planar(lens, points[other.corner], other.pixel)
        if p is None:
            return None
        turned.append((v, p, other))
    # Which of each pair of readings agree in angle with the arm: grow from the first view.
    best: tuple[float, list[Item]] | None = None
    for seed in range(min(3, len(items))):
        chosen = list(items)
        for k in range(len(items)):
            costs = []
            for candidate in (items[k], turned[k]):
                a = A[[items[seed][0], items[k][0]]]
                costs.append(angle_gap(a, [items[seed], candidate]))
            if k != seed and costs[1] + np.deg2rad(3) < costs[0]:
                chosen[k] = turned[k]
        gap = angle_gap(A[[v for v, _, _ in chosen]], chosen)
        if best is None or gap < best[0]:
            best = (gap, chosen)
    assert best is not None
    count = sum(a is not b for a, b in zip(best[1], items))
    count = min(count, len(items) - count)
    if not count:
        return None
    return _flip_finding(count, len(items)), best[1]


def some_flipped(problem: Problem, items: list[Item], fit: Fit, A: Poses) -> list[Finding]:
    """Boards read turned by 180 degrees among others that are read rightly."""
    lens = problem.lenses[items[0][2].lens].camera
    points = problem.boards[items[0][2].board].points
    C = se3.inverses(fit.start.X[None]) @ A @ fit.start.Z
    count = 0
    for v, _, s in items:
        if len(s.corner) != len(points):
            continue
        p = lens.project(points[s.corner] @ C[v, :3, :3].T + C[v, :3, 3])
        right = np.median(np.linalg.norm(p - s.pixel, axis=1))
        turned = np.median(np.linalg.norm(p - s.pixel[::-1], axis=1))
        count += bool(turned * BETTER < right and turned < max(6.0, 4 * fit.median_px))
    if not count:
        return []
    return [_flip_finding(count, len(items))]


def _flip_finding(count: int, total: int) -> Finding:
    return Finding(
        "flipped",
        "error",
        f"the board is read turned by 180 deg in {count} of {total} images",
        "use a board whose corners cannot be confused: a hollow corner square, ChArUco or tags",
    )
