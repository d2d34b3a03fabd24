"""The board's size against the arm's lengths: a print that is not what was said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.calibration.calibrate import Calibration
from armsight.calibration.covariance import covariance
from armsight.calibration.findings import Finding
from armsight.calibration.model import Model
from armsight.calibration.problem import Priors
from armsight.calibration.solver import SolverOptions, solve

PRINT = 0.002
"""Sigma of a print's scale that nobody wonders at [1]."""
SIGMAS = 4.0
WRONG = 0.01
"""A share by which a size is wrong, and not only badly printed [1]."""


def scale_findings(answer: Calibration, board: int = 0) -> list[Finding]:
    """Whether the data want a board of another size, by more than chance and the arm explain."""
    problem = answer.problem
    freedom = replace(answer.freedom, shape=True)
    wide = replace(answer.solution.model.priors or Priors(), board_scale=0.2)
    model = Model(problem, freedom, wide)
    options = SolverOptions(iterations=25, tolerance=1e-6, cut=12.0)
    solution = solve(model, answer.solution.state, options)
    scale = float(solution.state.shape[board, 0])
    at = model.shape_slice(board).start
    sigma = float(covariance(solution).sigma()[at])
    if abs(scale) < SIGMAS * np.hypot(sigma, PRINT):
        return []
    points = problem.boards[board].points
    step = 1e3 * float(np.linalg.norm(points[1:] - points[0], axis=1).min())
    return [
        Finding(
            "board_size",
            "error" if abs(scale) > WRONG else "warning",
            f"the corners of your board are {step * (1 + scale):.2f} mm apart, not {step:.2f} mm "
            f"({100 * scale:+.1f} %, sure to {100 * sigma:.1f} %), or the arm's lengths are off by "
            "as much",
            "measure the printed board over its whole length and give that size",
        )
    ]
