"""Rows that V's experiments share: shares with their bounds, medians of what got there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armsight.experiments.rows import Row, bootstrap, wilson

Budget = tuple[float, float] | None
"""Must and aim; None for a row that is none of ours."""


def share_row(
    key: str, say: str, where: str, good: Sequence[bool], paper: float | None, budget: Budget = None
) -> Row:
    """A share of trials with its Wilson bounds."""
    low, high = wilson(sum(good), max(len(good), 1))
    must, aim = budget or (None, None)
    return Row(
        key, f"{say}; 95 % by Wilson", where, sum(good) / max(len(good), 1), n=len(good), low=low,
        high=high, paper=paper, must=must, aim=aim, better="higher",
    )  # fmt: skip


def median_row(
    key: str,
    say: str,
    where: str,
    values: Sequence[float],
    unit: str,
    paper: float | None = None,
    budget: Budget = None,
) -> Row:
    """A median with its bootstrap bounds; of nothing it is missing, and says so."""
    must, aim = budget or (None, None)
    low = high = None
    if len(values) > 1:
        low, high = bootstrap(values, np.random.default_rng(0), "median")
    value = float(np.median(values)) if len(values) else math.nan
    return Row(
        key, f"median {say}; 95 % by bootstrap", where, value, unit, len(values), low, high, paper,
        must, aim, why="no trial got there",
    )  # fmt: skip


def harm_row(say: str, where: str, count: int, n: int) -> Row:
    """How much harm there was; there must be none."""
    return Row("harm", say, where, float(count), n=n, must=0.0, aim=0.0)
