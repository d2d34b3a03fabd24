"""Lengths that do not fit: a wrong unit, or a wrong board size."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Poses
from armsight.calibration.closed_form import shah
from armsight.calibration.diagnosis.reading import Item
from armsight.calibration.findings import Finding
from armsight.calibration.problem import Problem


def unit_scale(A: Poses, items: list[Item]) -> float | None:
    """Factor on the arm's positions that makes them fit the board's size; None without one."""
    views = [v for v, _, _ in items]
    C = np.array([p.T_lens_board[0] for _, p, _ in items])
    A = A[views]
    X, _ = shah(A, C)
    n = len(A)
    for _ in range(2):
        rows = np.zeros((3 * n, 7))
        rows[:, :3] = A[:, :3, :3].reshape(3 * n, 3)
        rows[:, 3:6] = np.tile(-np.eye(3), (n, 1))
        rows[:, 6] = A[:, :3, 3].reshape(3 * n)
        right = (C[:, :3, 3] @ X[:3, :3].T).reshape(3 * n)
        column = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
        t = np.linalg.lstsq(rows / column, right, rcond=None)[0] / column
        miss = np.linalg.norm((rows @ t - right).reshape(n, 3), axis=1)
        keep = miss <= 2.5 * np.median(miss)
        if keep.all() or keep.sum() < 4:
            break
        A, C, n = A[keep], C[keep], int(keep.sum())
        X, _Z = shah(A, C)
    scale = float(t[6])
    return scale if 1e-5 < scale < 1e5 else None


def scale_finding(scale: float, problem: Problem, items: list[Item]) -> Finding:
    """The name of a factor on the arm's positions: a unit, or else the board's size."""
    for factor, words, cure in (
        (1e-3, "the positions are in millimetres, not metres", "write metres"),
        (1e3, "the board's size is in millimetres, not metres", "give the board's size in metres"),
        (1e-2, "the positions are in centimetres, not metres", "write metres"),
        (0.0254, "the positions are in inches, not metres", "write metres"),
    ):
        if abs(np.log(scale / factor)) < 0.12:
            return Finding("millimetres", "error", f"{words}: so read, the data fit", cure)
    board = problem.boards[items[0][2].board]
    p = board.points
    square = float(np.min(np.linalg.norm(p[1:] - p[0], axis=1)))
    return Finding(
        "board_size",
        "error",
        f"angles agree but lengths do not: the board {board.name} would fit with corners "
        f"{1e3 * square / scale:.2f} mm apart, not {1e3 * square:.2f} mm",
        "measure the printed board over its whole length and give that size",
    )
