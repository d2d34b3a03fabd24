"""Force and depth over time while a plug goes in and comes out again: one trial of each type."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.insertion_bench import Trial, run_trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def first_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """The first trial of each type, in the types' order."""
    found: dict[str, Trial] = {}
    for trial in trials:
        found.setdefault(trial.port, trial)
    return [found[name] for name in sorted(found)]


def traced(trial: Trial, paper: bool) -> tuple[Floats, dict[str, Any]]:
    """Rows of time [s], depth [mm], force along and across [N] by the truth; and how it ended.

    Along is positive where the socket holds back a plug that goes in, negative where it holds one
    that is pulled.
    """
    rows: list[tuple[Any, ...]] = []
    result = run_trial(trial, paper=paper, trace=rows)
    begun = rows[0][0]
    curve = [
        (row[0] - begun, 1e3 * row[2], row[8], float(np.hypot(row[6], row[7]))) for row in rows
    ]
    return np.array(curve, float), result


def curves(trials: Sequence[Trial]) -> Figure:
    """Ours at the left, the charging paper's way at the right, a row for each trial."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.6 * len(trials)))
    for i, trial in enumerate(trials):
        for k, paper in enumerate((False, True)):
            curve, result = traced(trial, paper)
            time, depth, along, across = curve.T
            axes = figure.add_subplot(len(trials), 2, 2 * i + k + 1)
            axes.plot(time, along, label="along", linewidth=1.0)
            axes.plot(time, across, label="across", linewidth=1.0)
            axes.set_ylim(-60, 120)
            axes.set_ylabel("force [N]")
            deep = axes.twinx()
            deep.plot(time, depth, color="0.4", linestyle=":", label="depth")
            deep.set_ylim(-20, 40)
            deep.set_ylabel("depth [mm]")
            how = "the paper's way" if paper else "ours"
            end = "fully in" if result["full"] else f"{1e3 * result['true_depth']:.0f} mm deep"
            told = "told as in" if result["said"] else "told as failed"
            axes.set_title(f"{trial.port}, {how}: {end}, {told}", fontsize=9)
            if i == len(trials) - 1:
                axes.set_xlabel("time [s]")
            if i == k == 0:
                lines = [*axes.get_lines(), *deep.get_lines()]
                axes.legend(lines, [str(line.get_label()) for line in lines], fontsize=7, loc=1)
    figure.tight_layout()
    return figure
