"""One figure a row, in the layout of every result that armsight publishes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any, Literal

import numpy as np
from scipy import stats

Better = Literal["lower", "higher"]


@dataclass(frozen=True)
class Row:
    """One figure of an experiment, beside the paper's and the budget.

    Attributes:
        key: unique together with ``condition``; what a budget refers to.
        measure: in words.
        condition: under which it was measured, or empty.
        value: the figure; NaN is written as null and meets no budget.
        unit: of value, low, high, paper, must and aim; empty for counts and shares.
        n: how many trials or samples stand behind it.
        low, high: bounds of the stated uncertainty (95 % interval, or quantiles), or None.
        paper: the paper's figure, or None.
        must, aim: budget, or None.
        better: ``lower`` when a value at or below the budget meets it, else ``higher``.
        strict: the budget itself does not meet it ("< 1").
        why: where value is NaN, why there is no figure, in words; a table says it in its place.
    """

    key: str
    measure: str
    condition: str
    value: float
    unit: str = ""
    n: int = 1
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    must: float | None = None
    aim: float | None = None
    better: Better = "lower"
    strict: bool = False
    why: str = ""

    @property
    def met(self) -> bool | None:
        """Whether ``must`` is reached; None where there is none."""
        return self._reaches(self.must)

    @property
    def aimed(self) -> bool | None:
        """Whether ``aim`` is reached; None where there is none."""
        return self._reaches(self.aim)

    def _reaches(self, budget: float | None) -> bool | None:
        if budget is None:
            return None
        if math.isnan(self.value):
            return False
        if self.strict and self.value == budget:
            return False
        return bool(self.value <= budget if self.better == "lower" else self.value >= budget)

    def to_json(self) -> dict[str, Any]:
        """The row as JSON knows it: numbers as numbers, NaN and infinity as null."""
        fields = asdict(self)
        del fields["better"], fields["strict"], fields["why"]
        row = {k: _number(float(v)) if isinstance(v, Real) else v for k, v in fields.items()}
        return row | {"met": self.met}


def _number(value: float) -> float | int | None:
    if not math.isfinite(value):
        return None
    return int(value) if value.is_integer() and abs(value) < 2**53 else value


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's interval of a share, 0..1 (Wilson 1927); honest for 0 of n, too.

    Args:
        successes: how often it happened.
        trials: out of how many.
        confidence: of the two-sided interval.
    """
    if trials == 0:
        return 0.0, 1.0
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is no share")
    z = float(stats.norm.ppf(0.5 + 0.5 * confidence))
    share = successes / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = (
        z
        * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
        / (1 + z * z / trials)
    )
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    high = 1.0 if successes == trials else min(1.0, middle + half)
    return low, high


def poisson_bounds(events: int, confidence: float = 0.95) -> tuple[float, float]:
    """Exact interval of the expected number of events when this many were counted (Garwood)."""
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if events == 0 else 0.5 * float(stats.chi2.ppf(tail, 2 * events))
    return low, 0.5 * float(stats.chi2.ppf(1.0 - tail, 2 * events + 2))


def share_row(
    key: str,
    measure: str,
    condition: str,
    successes: int,
    trials: int,
    paper: float | None = None,
    must: float | None = None,
    aim: float | None = None,
    better: Better = "lower",
) -> Row:
    """The row of a share, 0..1, with Wilson's interval; see :class:`Row` for the rest.

    Args:
        key: see there.
        measure: see there.
        condition: see there.
        successes: how often it happened.
        trials: out of how many; of none the share is 0.
        paper: see there.
        must: see there.
        aim: see there.
        better: see there.
    """
    low, high = wilson(successes, trials)
    return Row(
        key, measure, condition, successes / max(trials, 1), n=trials, low=low, high=high,
        paper=paper, must=must, aim=aim, better=better,
    )  # fmt: skip


def contact_row(
    contacts: int, whom: str, condition: str, n: int, budget: float | None = 0.0
) -> Row:
    """The row of contacts that count: with whom, and how little their number proves.

    Args:
        contacts: how many.
        whom: "a person", "anything".
        condition: of the row.
        n: episodes or rounds.
        budget: both must and aim; None where none is set.
    """
    low, high = poisson_bounds(contacts)
    return Row(
        "contacts",
        f"contacts with {whom} while the arm moved faster than 0.05 m/s, and the 95 % interval of "
        "their expected number",
        condition,
        float(contacts),
        n=n,
        low=low,
        high=high,
        must=budget,
        aim=budget,
    )


def bootstrap(
    samples: Sequence[float],
    rng: np.random.Generator,
    statistic: Literal["mean", "median"] = "mean",
    confidence: float = 0.95,
    draws: int = 2000,
) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean or median of samples."""
    values = np.asarray(samples, float)
    if len(values) < 2:
        return math.nan, math.nan
    picked = values[rng.integers(0, len(values), (draws, len(values)))]
    figures = picked.mean(axis=1) if statistic == "mean" else np.median(picked, axis=1)
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(figures, [tail, 100.0 - tail])
    return float(low), float(high)
