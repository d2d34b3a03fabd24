"""A plot of the last half minute, as the page draws it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import viser

from armsight.arrays import Floats


def plot(
    gui: viser.GuiApi,
    title: str,
    data: tuple[Floats, ...],
    lines: Sequence[tuple[str, str]],
    seconds: float,
    *,
    top: float | None = None,
    legend: bool = False,
    order: float | None = None,
) -> Any:
    """A plot of one line or more over time.

    Args:
        gui: of the page.
        title: with the unit.
        data: times before now [s], and the values of each line.
        lines: name and colour of each.
        seconds: how far back it reaches [s].
        top: of the scale, which then begins at 0; fitted to the lines when None.
        legend: whether the lines are named below it.
        order: place among the panel's parts.
    """
    axis: Any = {
        "stroke": "#94a3b8",
        "grid": {"stroke": "rgba(148,163,184,.15)", "width": 1},
        "ticks": {"show": False},
        "size": 34,
    }
    limits: Any = {"range": (0.0, top)} if top is not None else {"auto": True}
    series: Any = ({"label": "t"}, *({"label": n, "stroke": c, "width": 2} for n, c in lines))
    return gui.add_uplot(
        data=data,
        series=series,
        scales={"x": {"time": False, "range": (-seconds, 0.0)}, "y": limits},
        axes=(axis | {"size": 26}, axis),
        title=title,
        legend={"show": legend},
        cursor={"show": False},
        aspect=2.1,
        order=order,
    )
