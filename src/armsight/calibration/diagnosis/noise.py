"""Pictures whose corners scatter far more than others': blurred, glaring, or another thing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.calibrate import Calibration
from armsight.calibration.findings import Finding, names_of
from armsight.calibration.noise import scatter_within
from armsight.calibration.solver import Solution

TIMES = 4.0
"""Scatter over the usual one that is no chance [1]."""


def noise_findings(answer: Calibration, rig: int, names: Sequence[str]) -> list[Finding]:
    """Views whose corners scatter within their own picture."""
    solution = answer.solution
    model = solution.model
    mine = np.flatnonzero(model.rig_of == rig)
    if len(mine) < 6:
        return []
    scatter = _scatter(solution)[mine]
    usual = float(np.median(scatter))
    bad = [(int(model.view_of[f]), s) for f, s in zip(mine, scatter) if s > TIMES * usual]
    if not bad or len(bad) > 0.3 * len(mine):
        return []
    words = names_of([names[v] if v < len(names) else str(v) for v, _ in bad])
    return [
        Finding(
            "blurred",
            "warning",
            f"{words}: corners scatter by {max(s for _, s in bad):.2f} px within the picture, "
            f"usual are {usual:.2f} px: blurred, or glare",
            "leave it out; let the arm rest for 0.3 s, and light the board",
        )
    ]


def _scatter(solution: Solution) -> Floats:
    """(F,) usual distance of a corner from where its own board's best pose puts it [px]."""
    return np.asarray(np.sqrt(scatter_within(solution)), np.float64)
