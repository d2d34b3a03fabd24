"""The course of a training: in the terminal while it runs, and as a picture."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armsight.errors import RecognitionError
from armsight.writing import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEVELS = "▁▂▃▄▅▆▇█"
_SHOWN = ("loss", "mask", "joints", "base", "type", "links", "heat", "coordinates")


def sparkline(values: Sequence[float], width: int = 40) -> str:
    """A curve as one line of text, on a logarithmic scale; its last value to the right."""
    if not values:
        return ""
    width = min(width, len(values))
    edges = [round(k * len(values) / width) for k in range(width + 1)]
    means = []
    for first, last in itertools.pairwise(edges):
        part = values[first:last]
        means.append(math.log(max(sum(part) / len(part), 1e-12)))
    low, high = min(means), max(means)
    span = (high - low) or 1.0
    return "".join(_LEVELS[round((m - low) / span * (len(_LEVELS) - 1))] for m in means)


def line(curve: Sequence[dict[str, Any]], stage: str, updates: int) -> str:
    """One line about where a training stands: the last record, and the curve of this stage."""
    if not curve:
        return ""
    last = curve[-1]
    mine = [r["loss"] for r in curve if r["stage"] == last["stage"]]
    terms = " ".join(f"{k} {last[k]:.3f}" for k in _SHOWN if k in last)
    return f"{stage} {last['update']}/{updates} {sparkline(mine)} {terms}"


def draw(curve: Sequence[dict[str, Any]], stages: Sequence[str], file: Path) -> bool:
    """Draw the losses over the updates into a PNG; False where there is no matplotlib.

    Raises:
        RecognitionError: the file cannot be written.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return False
    picture = io.BytesIO()
    figure(curve, stages).savefig(picture, format="png", dpi=110, metadata={"Software": None})
    write_atomically(file, picture.getvalue(), error=RecognitionError)
    return True


def figure(curve: Sequence[dict[str, Any]], stages: Sequence[str]) -> Figure:
    """The losses over the updates, stage after stage; dots are validation samples."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.5))
    axes = drawn.subplots()
    start = 0
    for number, stage in enumerate(stages):
        records = [r for r in curve if r["stage"] == number]
        if not records:
            continue
        at = [start + r["update"] for r in records]
        for k, name in enumerate(_SHOWN):
            if name not in records[0]:
                continue
            # Each name once in the legend, from the first stage that has it.
            label = name if all(name not in r for r in curve if r["stage"] < number) else None
            axes.plot(at, [r[name] for r in records], f"C{k}", lw=2 if k == 0 else 1, label=label)
            checked = {
                x: r["validation"][name]
                for x, r in zip(at, records, strict=True)
                if name in r.get("validation", {})
            }
            axes.plot(list(checked), list(checked.values()), f".C{k}")
        axes.axvline(start, color="0.6", lw=0.8)
        axes.text(start, 1.01, f" {stage}", transform=axes.get_xaxis_transform(), fontsize=8)
        start = at[-1]
    axes.set(xlabel="update", ylabel="loss (lines: training, dots: validation)", yscale="log")
    axes.legend(loc="upper right", fontsize=8)
    axes.grid(alpha=0.3)
    return drawn
