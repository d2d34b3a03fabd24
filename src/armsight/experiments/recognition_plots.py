"""Pictures of the experiment on the papers' networks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armsight.experiments.recognition_rows import (
    EDGES,
    GROUPS,
    LEAST,
    SAMPLE_COUNTS,
    median_mm,
)
from armsight.experiments.recognition_scores import Tried
from armsight.experiments.rows import Row
from armsight.recognition.metrics import against

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def overlays(t: Tried) -> Figure:
    """Twelve test frames, spread from the best to the worst: truth white, answer red."""
    from matplotlib.figure import Figure

    order = np.argsort(t.scores.add)
    picked = order[np.linspace(0, len(order) - 1, min(12, len(order))).round().astype(int)]
    figure = Figure(figsize=(12.0, 8.2))
    axes = figure.subplots(3, 4).ravel()
    for axis in axes:
        axis.axis("off")
    for axis, k in zip(axes, picked, strict=False):
        sample = int(t.scores.samples[k])
        image = t.data.images[sample]
        answer = t.model.run(image)
        axis.imshow(image)
        axis.contour(answer.mask >= 0.5, [0.5], colors="orange", linewidths=0.8)
        count = int((~np.isnan(t.data.joints[sample, :, 0])).sum())
        truth = np.vstack([t.data.base[sample][None], t.data.joints[sample, :count]])
        said = np.vstack([answer.base[None], answer.joints[:count]])
        for points, style in ((truth, "w.-"), (said, "r.-")):
            px = points @ t.data.K[sample].T
            front = px[:, 2] > 0.05
            axis.plot(*(px[front, :2] / px[front, 2:]).T, style, ms=3, lw=1)
        axis.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(image.shape[0] - 0.5, -0.5))
        axis.set_title(
            f"{t.scores.robot[k]}, said {t.scores.said[k]}; {1e3 * t.scores.add[k]:.0f} mm",
            fontsize=8,
        )
    figure.suptitle(
        f"{t.model.card['paper']}, {t.condition}: from the best to the worst frame; "
        "truth white, answer red, mask orange"
    )
    return figure


def samples_plot(rows: list[Row]) -> Figure:
    """Median joint error against the number of training samples, T6's and T7's figures 5."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2))
    axis = figure.subplots()
    for name in SAMPLE_COUNTS:
        mine = [r for r in rows if r.key == f"{name}_samples_joint_median_mm"]
        counts = [int(r.condition.split()[0]) for r in mine]
        if counts:
            axis.plot(counts, [r.value for r in mine], "o-", label=name.upper())
    axis.set(xlabel="training samples of each robot", ylabel="median joint error [mm]")
    axis.set_ylim(bottom=0)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return figure


def distance_plot(tried: list[Tried]) -> Figure:
    """Median joint error against distance, T7's figure 5c."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2))
    axis = figure.subplots()
    for line, t in zip(("-", "--"), [t for t in tried if t.own], strict=False):
        for colour, (group, robots) in enumerate(GROUPS.items()):
            s = t.scores.of(np.isin(t.scores.robot, robots))
            bins = [b for b in against(s.add, s.distance, EDGES) if len(b[2]) >= LEAST]
            if bins:
                at = [0.5 * (low + high) for low, high, _ in bins]
                label = f"{group}, {t.condition}"
                axis.plot(at, [median_mm(v) for _, _, v in bins], f"o{line}C{colour}", label=label)
    axis.set(xlabel="distance of the base [m]", ylabel="median joint error [mm]")
    axis.set_ylim(bottom=0)
    # Beside it: there is no empty corner for so many lines.
    axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axis.grid(alpha=0.3)
    return figure
