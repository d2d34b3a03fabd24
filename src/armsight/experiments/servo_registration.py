"""``servo-registration``: V's first step, how far off a point is afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.experiments.calibration_sphere import cells
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.experiments.wrist_registration import cells as wrist_cells

ABOUT = """
`armsight calibrate ur10_servoing --sphere` in rendered cells with all their errors, the same cells
as those of `calibration-sphere`. True errors of points over the table as each fixed camera that
sees them has them afterwards, by lens and pose: over a grid up to half a metre above the table the
mean, and in the worst of the four corners of what is mapped. V: 3 cm, 5 cm in the corners.

`wrist_mm`: `armsight calibrate ur10_servoing --wrist` in such cells, the ball standing still. True
errors of points 0.2 to 0.4 m before the pair, in four fifths of its picture, as it has them
afterwards through its lenses and the arm's joints, which stand up to 0.5 rad from home: lenses,
mount, the arm's geometry and its sag are as drawn, the pictures' noise in the looks is the
renderer's. A pair whose calibration fails counts where the cell's file has it. V: 1 cm.
`wrist_arm_mm` is what the arm and the lenses leave where the mount is exact.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` cells."""
    done = cells(runs, seed, lambda say, share: progress(say, 0.5 * share))
    wrists = wrist_cells(runs, seed, lambda say, share: progress(say, 0.5 + 0.5 * share))
    rows = (
        _row("registration_mm", "mean error of a point over the table", _means(done), 30.0),
        _row("registration_corner_mm", "error in the worst corner", _corners(done), 50.0),
    )
    return Outcome((*rows, *_wrist_rows(wrists)), {}, (_wrist_note(wrists),))


def _wrist_rows(done: list[dict[str, Any]]) -> tuple[Row, ...]:
    """What the pair sees through the joints."""

    def row(key: str, say: str, field: str, paper: float | None, *budget: float) -> Row:
        values = [1e3 * r[field] for r in done if r[field] is not None]
        low, high = np.percentile(values, [5, 95])
        must, aim = budget or (None, None)
        return Row(
            key, f"{say}; median of cells, 5 to 95 % of them", "ours, the cell's errors",
            float(np.median(values)), "mm", len(values), float(low), float(high), paper, must, aim,
        )  # fmt: skip

    contacts = sum(r["contacts"] for r in done)
    return (
        row("wrist_mm", "mean error of a point through the pair and the joints", "after", 10.0,
            2.0, 1.0),
        row("wrist_p95_mm", "its 95th percentile", "p95", None),
        row("wrist_before_mm", "mean error before: as the cell's file says", "before", None),
        row("wrist_arm_mm", "mean error with the true mount: the arm's and the lenses'", "exact",
            None),
        row("wrist_stated_mm", "what the covariance says for 0.3 m", "stated", None),
        Row("harm", "contacts of the arm while it calibrates its pair", "ours", float(contacts),
            n=len(done), must=0.0, aim=0.0),
    )  # fmt: skip


def _wrist_note(done: list[dict[str, Any]]) -> str:
    looks, seconds = (np.mean([r[key] for r in done]) for key in ("looks", "seconds"))
    failed = [r["why"] for r in done if r["why"]]
    return (
        f"The pair took {looks:.0f} looks that counted, in {seconds:.0f} s of robot time. "
        f"Calibrations that failed: {len(failed)} of {len(done)}"
        + (f" ({'; '.join(sorted(set(failed)))})." if failed else ".")
    )


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
