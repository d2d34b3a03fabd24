"""The rows of the charging station's visits: one set of keys, three ways of looking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.experiments.car_nudges import KINDS
from armsight.experiments.charging_visits import FORCE
from armsight.experiments.rows import Row, share_row, wilson

Visits = Sequence[dict[str, Any]]

SHARES = (
    ("seated", "fully in, and said so", "full", 0.3, 0.95, 0.98),
    ("unplugged", "out again at the end, of those that were seated", "out", 1.0, 0.99, 0.995),
)
FIGURES = (
    ("cycle_s", "stand-by to seated, median", "s", 45.0, 30.0),
    ("insert_s", "from the approach pose to seated, median", "s", 15.0, 8.0),
)


def visit_rows(visits: Visits, where: str, prefix: str = "", waits: bool = False) -> list[Row]:
    """Rows of visits in which nothing is meant to go wrong.

    Args:
        visits: of one condition.
        where: that condition, in words.
        prefix: of the keys, for those that no budget holds.
        waits: for people who come between: then its times have keys of their own, and no budget.
    """
    ours = not prefix
    rows = []
    for key, what, field, paper, must, aim in SHARES:
        some = visits if key == "seated" else [v for v in visits if v["said"]]
        budget = (paper, must, aim) if ours else (None, None, None)
        rows.append(_share(prefix + key, what, where, some, field, *budget))
    for key, what, count in (
        ("partial_as_success", "said to be seated, and not fully in", _partial),
        ("harm", f"contacts that no permit covers, or more than {FORCE:.0f} N", _harm),
    ):
        bad = sum(count(v) for v in visits)
        budget_of_none = 0.0 if ours else None
        rows.append(
            Row(
                prefix + key, what, where, bad, n=len(visits),
                must=budget_of_none, aim=budget_of_none,
            )
        )  # fmt: skip
    for key, what, unit, must, aim in FIGURES:
        budgets = (must, aim) if ours and not waits else (None, None)
        name = f"waited_{key}" if waits else prefix + key
        said = f"{what}, waiting for people counted in" if waits else what
        rows += _median(name, said, where, visits, key, unit, *budgets)
    rows += _median(prefix + "axial_n", "greatest axial force", where, visits, "axial_n", "N")
    rows += _median(prefix + "lateral_n", "greatest lateral force", where, visits, "lateral_n", "N")
    pulls = [v["pull_n"] for v in visits if v["said"]]
    if pulls:
        budget_n = (125.0, 110.0) if ours else (None, None)
        what = "greatest force that held the plug on the way out, of all"
        rows.append(
            Row(
                prefix + "unplug_n", what, where, max(pulls), "N", len(pulls),
                must=budget_n[0], aim=budget_n[1],
            )
        )  # fmt: skip
    return rows


def rows_of(visits: Visits, where: str, what: str) -> list[Row]:
    """Shares of seated visits by what was drawn of them, such as their light."""
    return [
        _share("seated_in", "fully in, and said so", f"{where}: {value}", mine, "full")
        for value in sorted({v[what] for v in visits})
        for mine in [[v for v in visits if v[what] == value]]
    ]


def fault_rows(wrong: Visits, where: str, prefix: str = "") -> list[Row]:
    """Rows of visits in which something goes wrong, all of them and by what it was."""
    budget = (1.0, 0.98, 1.0) if not prefix else (None, None, None)
    what = "ended safe and named rightly"
    rows = [_share(f"{prefix}recovered", what, where, wrong, "good", *budget)]
    for fault in dict.fromkeys(v["fault"] for v in wrong):
        mine = [v for v in wrong if v["fault"] == fault]
        rows.append(_share(f"{prefix}recovered_of", what, f"{where}: {fault}", mine, "good"))
    moved = [v for v in wrong if v["fault"] in KINDS]
    for key, force in (("axial_n", "along"), ("lateral_n", "across"), ("pull_n", "on the way out")):
        if moved:
            said = f"greatest force {force} while somebody moves the car"
            peak = max(v[key] for v in moved)
            rows.append(Row(f"{prefix}moved_{key}", said, where, peak, "N", len(moved)))
    return rows


def agreement_row(one: Visits, other: Visits, words: str) -> Row:
    """How far two conditions' shares of seated visits are apart, with the interval of that.

    The interval is Newcombe's of a difference, of the two Wilson intervals (1998, method 10).
    """
    shares, lows, highs = [], [], []
    for some in (one, other):
        good = sum(bool(v["full"]) for v in some)
        low, high = wilson(good, len(some))
        shares.append(good / max(len(some), 1))
        lows.append(low)
        highs.append(high)
    gap = shares[0] - shares[1]
    low = gap - math.hypot(shares[0] - lows[0], highs[1] - shares[1])
    high = gap + math.hypot(highs[0] - shares[0], shares[1] - lows[1])
    what = "difference of the shares of seated visits; the two agree where the interval holds 0"
    return Row("seated_gap", what, words, gap, n=min(len(one), len(other)), low=low, high=high)


def _partial(visit: dict[str, Any]) -> bool:
    return bool(visit["said"] and not visit["full"])


def _harm(visit: dict[str, Any]) -> bool:
    return bool(visit["harm"])


def _share(
    key: str,
    what: str,
    where: str,
    some: Visits,
    field: str,
    paper: float | None = None,
    must: float | None = None,
    aim: float | None = None,
) -> Row:
    good = sum(bool(v[field]) for v in some)
    return share_row(key, what, where, good, len(some), paper, must, aim, "higher")


def _median(
    key: str,
    what: str,
    where: str,
    visits: Visits,
    field: str,
    unit: str,
    must: float | None = None,
    aim: float | None = None,
) -> list[Row]:
    values = np.array([v[field] for v in visits if np.isfinite(v[field])])
    if not len(values):
        return []
    spread = float(values.min()), float(values.max())
    return [
        Row(key, what, where, float(np.median(values)), unit, len(values), *spread, None, must, aim)
    ]
