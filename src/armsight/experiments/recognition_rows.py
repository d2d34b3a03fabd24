"""What the rows on the papers' networks have in common: robots, bins, and figures of scores."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.recognition_scores import UNSEEN, Tried
from armsight.experiments.rows import wilson
from armsight.recognition.training.figures import Scores

URS = ("ur3", "ur5", "ur10")
GROUPS = {"UR": URS, "KUKA": ("iiwa",), "Panda": ("panda",)}
SAMPLE_COUNTS = {"t6": (100, 200, 312, 600, 1200, 1800), "t7": (100, 250, 500, 750)}
EDGES = np.array([1.2, 1.4, 1.6, 1.8, 2.0, 2.25, 2.5])
"""[m]; distances of T7's figure 5."""
PAPERS = {"t4": ("ur5",), "t5": URS, "t6": ("iiwa",), "t7": (*URS, "iiwa", "panda")}
GROUNDS = ("", "-rooms")
"""Trained on the papers' recordings, and on one room a picture."""
LEAST = 5


def or_nothing(tried: list[Tried]) -> list[Tried] | list[None]:
    """What was tried, or one row without figures."""
    return tried or [None]


def under(t: Tried | None) -> str:
    """The condition that a row is under."""
    return t.condition if t else ""


def size(scores: Scores | None) -> int:
    """Frames behind a figure."""
    return 0 if scores is None else len(scores.add)


def mean(scores: Scores | None, name: str, factor: float = 1.0) -> float:
    """Mean of a figure over frames, times a factor; NaN where nothing was tried."""
    return np.nan if scores is None else factor * float(np.mean(getattr(scores, name)))


def median_mm(values: Floats) -> float:
    """Median of (n,) metres [mm]."""
    return 1e3 * float(np.median(values))


def type_right(scores: Scores | None) -> float:
    """Share of the frames with the right type [%]."""
    return np.nan if scores is None else 100.0 * float((scores.said == scores.robot).mean())


def type_bounds(scores: Scores | None) -> tuple[float | None, float | None]:
    """Its bounds (Wilson) [%]."""
    if scores is None:
        return None, None
    low, high = wilson(int((scores.said == scores.robot).sum()), len(scores.robot))
    return 100.0 * low, 100.0 * high


def bounds_of(t: Tried | None) -> Any:
    """Budgets hold in the training renderer's unseen scenes; the rest is reported without."""

    def bounds(must: float, aim: float | None) -> dict[str, float | None]:
        if t is not None and t.where != UNSEEN:
            return {}
        return {"must": must, "aim": aim}

    return bounds
