"""The course of a training: in the terminal while it runs, and as a picture."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armsight.errors import RecognitionError

_LEVELS = "▁▂▃▄▅▆▇█"
_SHOWN = ("loss", "mask", "joints", "base", "type")


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
        from matplotlib.figure import Figure
    except ImportError:
        return False
    figure = Figure(figsize=(8.0, 4.5))
    axes = figure.subplots()
    start = 0
    places: list[int] = []
    for number, stage in enumerate(stages):
        records = [r for r in curve if r["stage"] == number]
        if not records:
            continue
        at = [start + r["update"] for r in records]
        for k, name in enumerate(_SHOWN):
            if name in records[0]:
                axes.plot(
                    at, [r[name] for r in records], color=f"C{k}", lw=2 if k == 0 else 1,
                    label=name if not places else None,
                )  # fmt: skip
                checked = [(x, r["validation"][name]) for x, r in zip(at, records, strict=True)
                           if name in r.get("validation", {})]  # fmt: skip
                axes.plot(*zip(*checked, strict=True), ".", color=f"C{k}") if checked else None
        axes.axvline(start, color="0.6", lw=0.8)
        axes.text(start, 1.01, f" {stage}", transform=axes.get_xaxis_transform(), fontsize=8)
        places.append(start)
        start = at[-1]
    axes.set(xlabel="update", ylabel="loss (lines: training, dots: validation)", yscale="log")
    axes.legend(loc="upper right", fontsize=8)
    axes.grid(alpha=0.3)
    part = file.with_name(f".{file.name}.part")
    try:
        figure.savefig(part, format="png", dpi=110, metadata={"Software": None})
        part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RecognitionError(f"{file}: cannot be written ({error.strerror or error})") from None
    return True
