"""``servo-registration``: V's first step, how far off a point over the table is afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.experiments.calibration_sphere import cells
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row

ABOUT = """
`armsight calibrate ur10_servoing --sphere` in rendered cells with all their errors, the same cells
as those of `calibration-sphere`. True errors of points over the table as each fixed camera that
sees them has them afterwards, by lens and pose: over a grid up to half a metre above the table the
mean, and in the worst of the four corners of what is mapped. V: 3 cm, 5 cm in the corners.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` cells."""
    done = cells(runs, seed, progress)
    rows = (
        _row("registration_mm", "mean error of a point over the table", _means(done), 30.0),
        _row("registration_corner_mm", "error in the worst corner", _corners(done), 50.0),
    )
    return Outcome(rows, {}, ("`wrist_mm`, the pair through the joints, has no procedure here.",))


def _row(key: str, say: str, values: list[float], paper: float) -> Row:
    low, high = np.percentile(values, [5, 95])
    return Row(
        key, f"{say}; median of cells, 5 to 95 % of them", "ours, the cell's errors",
        float(np.median(values)), "mm", len(values), float(low), float(high), paper, 10.0, 5.0,
    )  # fmt: skip


def _means(done: list[dict[str, Any]]) -> list[float]:
    """Of each cell the mean over its cameras and what they see [mm]."""
    seen = [[o for c in r["cameras"] for o in c["table"] if o is not None] for r in done]
    return [1e3 * float(np.mean(off)) for off in seen]


def _corners(done: list[dict[str, Any]]) -> list[float]:
    """Of each cell the worst corner, a corner's error being the mean of the cameras' [mm]."""
    out = []
    for r in done:
        corners = zip(*(c["corners"] for c in r["cameras"]))
        seen = [[o for o in corner if o is not None] for corner in corners]
        out.append(1e3 * max(float(np.mean(off)) for off in seen if off))
    return out


EXPERIMENT = Experiment(
    "servo-registration", "Fixed cameras registered (V): errors over the table", run, 6, ABOUT
)
