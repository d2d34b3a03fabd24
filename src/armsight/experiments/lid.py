"""Opening a charging lid and shutting it again by feel, in contact physics."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from armsight.experiments.cache import RunCache
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.lid_bench import Fault, LidTrial, draw, run_trial
from armsight.experiments.lid_visits import lid_visit
from armsight.experiments.rows import Row, share_row
from armsight.simulation.spec import Latch

ABOUT = """
A UR10 in MuJoCo as in `insertion`, with a finger beside its plug: a rod of 10 mm with a pin of 15
mm across its tip, 5 cm before the plug's mouth, in the plug's soft mount. A lid of 150 x 150 x 8
mm on a hinge at its left, on a flank that is turned by up to 30 deg and leans by up to 10; to its
right a recess for fingers. Two latches, 15 to 30 N at the free edge: `push`, which lets go of
what is pressed in, a spring lifting the lid by 12 deg; `spring`, a catch to be pulled over. A
spring in the hinge holds it open from 40 deg on. What is believed of the lid is off by 1.5 mm and
0.8 deg along and about each axis (standard deviations). The law (`charging/lid.py`) is told
joints and wrench alone, and which latch it is; *not told*: half as many of each, where pressing is
tried before pulling. Opened: 85 deg or more by the truth, *and* said so; shut again: in its latch
by the truth, *and* said so, of all. In a quarter as many trials something is wrong: frozen shut,
jams at 35 deg, missing, a latch that does not hold; named: the words say so.

`visit_*`: whole visits of the station in contact physics (no guard), a quarter as many of each
latch: the car parked within 10 x 20 cm and 10 deg, the lid found in rendered pictures, from the
post and from 0.4 m, opened, the plug seated behind it and out again, the lid shut. Not modelled:
lids that slide.
"""
LATCHES: tuple[Latch, ...] = ("push", "spring")
FAULTS: tuple[Fault, ...] = ("stuck", "half", "missing", "no latch")
NAMED: dict[Fault, tuple[str, ...]] = {
    "stuck": ("stays shut", "is stuck"),
    "half": ("stuck at",),
    "missing": ("no lid",),
    "no latch": ("springs open again", "stays shut"),
}
"""One of these has to stand in the words."""
BUDGET = (0.90, 0.95)


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` trials of each latch, and a quarter as many of each in which something is wrong."""
    cache = RunCache("lid", seed)
    good: list[dict[str, Any]] = []
    wrong: list[dict[str, Any]] = []
    for i in range(runs):
        for k, latch in enumerate(LATCHES):
            progress(latch, (i + 0.5 * k) / (2.2 * runs))
            rng = np.random.default_rng((seed, 61, k, i))
            good.append(cache.get(2 * i + k, partial(_scored, draw(rng, latch))))
    for i in range(max(2 * runs // 4, 1)):
        latch, fault = LATCHES[i % 2], FAULTS[(i // 2) % len(FAULTS)]
        progress(fault, (runs + 0.5 * i) / (2.2 * runs))
        rng = np.random.default_rng((seed, 62, i))
        wrong.append(cache.get(10**5 + i, partial(_scored, draw(rng, latch, fault))))
    for i in range(max(runs // 2, 1)):
        for k, latch in enumerate(LATCHES):
            progress(f"{latch}, not told", (1.25 * runs + 0.05 * i) / (2.2 * runs))
            rng = np.random.default_rng((seed, 64, k, i))
            trial = draw(rng, latch, told=False)
            good.append(cache.get(3 * 10**5 + 2 * i + k, partial(_scored, trial)))
    each = range(max(runs // 4, 1))
    visits: list[dict[str, Any]] = []
    for k, latch in enumerate(LATCHES):
        visit, share = partial(lid_visit, latch=latch), part_of(progress, 0.6 + 0.2 * k, 0.2)
        visits += run_episodes("lid", visit, each, seed, share, f"visits, {latch}")
    rows = []
    told = [v for v in good if v["told"]]
    kinds = {f"{latch} latch": [v for v in told if v["latch"] == latch] for latch in LATCHES}
    kinds["latch not told, of both"] = [v for v in good if not v["told"]]
    for condition, mine in kinds.items():
        rows.append(_share("lid_opened", "open, and said so", condition, mine, "opened"))
        rows.append(_share("lid_closed", "shut again, and said so", condition, mine, "shut"))
    for key, what in (("open_s", "to open it"), ("shut_s", "to shut it")):
        times = [v[key] for v in told if v["opened"] and np.isfinite(v[key])]
        if times:
            low, high = min(times), max(times)
            median = float(np.median(times))
            rows.append(Row(f"lid_{key}", what, "median", median, "s", len(times), low, high))
    forces = [v["force_n"] for v in [*good, *wrong]]
    what = "greatest force on the finger, of all"
    rows.append(Row("lid_n", what, "both latches", max(forces), "N", len(forces)))
    named = [v | {"named": _named(v)} for v in wrong]
    rows.append(_share("lid_named", "what is wrong is said", "stuck, jammed, missing, no latch",
                       named, "named", None))  # fmt: skip
    some = "pictures searched, contact physics"
    for key, field, what in (
        ("visit_opened", "opened", "lid found and opened, plug seated behind it"),
        ("visit_closed", "shut", "lid shut again after the visit"),
        ("visit_out", "out", "plug out again"),
    ):
        rows.append(_share(key, what, some, visits, field, None if field == "out" else BUDGET))
    times = [v["cycle_s"] for v in visits if v["opened"]]
    if times:
        low, high, what = min(times), max(times), "stand-by to seated, with the lid"
        median = float(np.median(times))
        rows.append(Row("visit_cycle_s", what, some, median, "s", len(times), low, high))
    notes = tuple(
        f"{v['latch']} {v['fault']}: {v['open_said'] or v['shut_said'] or 'nothing said'}"
        for v in [*good, *named]
        if (not v["fault"] and not v["shut"]) or (v["fault"] and not v["named"])
    ) + tuple(f"visit, {v['latch']}: {v['problem']}" for v in visits if v["problem"])
    return Outcome(tuple(rows), notes=notes)


def _scored(trial: LidTrial) -> dict[str, Any]:
    return run_trial(trial)


def _named(visit: dict[str, Any]) -> bool:
    said = f"{visit['open_said']} {visit['shut_said']}"
    return any(words in said for words in NAMED[visit["fault"]])


def _share(
    key: str,
    what: str,
    condition: str,
    some: list[dict[str, Any]],
    field: str,
    budget: tuple[float, float] | None = BUDGET,
) -> Row:
    good = sum(bool(v[field]) for v in some)
    must, aim = budget or (None, None)
    return share_row(key, what, condition, good, len(some), None, must, aim, "higher")


EXPERIMENT = Experiment(
    "lid", "A charging lid opened and shut by feel, in contact physics", run, runs=30, about=ABOUT
)
