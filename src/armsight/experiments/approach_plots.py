"""The pictures of ``approach``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_distances(episodes: list[dict[str, Any]]) -> Figure:
    """How near people came, in all and while the arm moved."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.5))
    axes = figure.subplots()
    bins = np.linspace(0.0, 1.5, 46).tolist()
    for key, label in (("least", "arm standing or moving"), ("least_moving", "while it moved")):
        axes.hist(np.minimum([e[key] for e in episodes], 1.5), bins, alpha=0.6, label=label)
    axes.set(xlabel="least true distance of an episode [m]", ylabel="episodes")
    axes.legend()
    return figure


def plot_course(episodes: list[dict[str, Any]]) -> Figure:
    """Distance, protective distance and speed over one episode: the liveliest with a led hand."""
    from matplotlib.figure import Figure

    traced = [e for e in episodes if e["trace"]]
    shown = max(traced, key=lambda e: (e["led"] and e["least"] < 0.2, e["moved"]))
    t = shown["trace"]
    figure = Figure(figsize=(8, 5))
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(t["time"], t["distance"], label="distance to whoever may be nearest, as seen")
    above.plot(t["time"], t["protective"], "--", label="protective distance at the present speed")
    above.plot(t["true_time"], t["true_distance"], color="tab:green", label="true distance to skin")
    above.set(ylabel="[m]", ylim=(0.0, 1.4))
    above.legend(loc="upper right", fontsize=8)
    below.plot(t["true_time"], t["tip_speed"], color="tab:red", label="true speed of the tip [m/s]")
    below.plot(t["time"], t["scale"], color="tab:gray", lw=1, label="speed scale")
    below.set(xlabel="time [s]", ylim=(0.0, None))
    below.legend(loc="upper right", fontsize=8)
    figure.align_ylabels()
    return figure
