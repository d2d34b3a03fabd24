"""Plugging in by force, in contact physics: ours beside the charging paper's halt."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.charging.admittance import Admittance
from armsight.charging.insert import InsertOptions
from armsight.charging.spiral import SpiralOptions
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.insertion_bench import Trial, draw, run_trial
from armsight.experiments.insertion_curves import curves, first_of_each
from armsight.experiments.rows import Row, share_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """
A UR10 in MuJoCo (1 ms steps, drives with the URDF's torques, 60 ms from command to motion), a plug
of 1.6 kg in a mount of 5 N/mm and 30 N m/rad with 10 to 30 N of cable, a force sensor with noise
and bias at the flange, Type 1, Type 2 and CCS2 sockets of boxes and capsules from the table of
measures: clearance 0.3 to 0.6 mm, chamfer 1.5 to 2 mm, friction 0.1 to 0.4, mated contacts that
rub with 10 to 35 N. What is believed of the port is off by the stated distance and tilt in random
directions, 0.4 deg of roll and 0.3 mm of depth (standard deviations). The law is told joints and
wrench alone. Inserted: within 1 mm of the seat and 2 deg by the truth, *and* said so. Forces are
those of the socket and its contacts on the plug by the truth, read 125 times a second: 99th
percentile of the trials' peaks. `paper_*`: along Z at 10 mm/s, halted at 60 N or 8 N m, the same
situations. `ablation_*`: our law with one thing taken away, the same situations. *Stiff tilt*: the
arm keeps the attitude that is believed of the port, and yields along its axes only; its mount is
as soft as ever. *No search*: no spiral; what does not drop in is tried again where it was, four
times in all. Not modelled: the contacts' tubes and pins, the latch, the shroud about the outer
sleeve's outside.
"""
GROUPS = (("off", 5e-3, 5.0), ("search", 8e-3, 3.0), ("near", 1.5e-3, 1.0))
ABLATIONS = {
    "ablation_stiff_tilt_": InsertOptions(admittance=Admittance(speed=(0.025, 0.0))),
    "ablation_no_search_": InsertOptions(spiral=SpiralOptions(radius=0.0)),
}
"""Our law with one thing taken away, by the prefix of its rows."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` trials each: from 5 mm and 5 deg, from 8 mm and 3 deg, from 1.5 mm and 1 deg.

    The paper's way and the near ablations have half as many.
    """
    cache = RunCache("insertion", seed)
    results: dict[str, list[dict[str, Any]]] = {}
    half = max(runs // 2, 1)
    total, done = 3 * runs + 2 * half + len(ABLATIONS) * (runs + half), 0
    drawn: dict[str, list[Trial]] = {}
    for k, (name, lateral, tilt) in enumerate(GROUPS):
        rng = np.random.default_rng((seed, 31 + k))
        trials = drawn[name] = [draw(rng, lateral, tilt) for _ in range(runs)]
        # prefix of the rows, number in the cache, how many, how
        ways = [("", 2 * k, runs, run_trial)]
        if name != "search":
            ways.append(("paper_", 2 * k + 1, half, partial(run_trial, paper=True)))
            ways += [
                (prefix, 10 * (j + 1) + k, runs if name == "off" else half,
                 partial(run_trial, options=options))
                for j, (prefix, options) in enumerate(ABLATIONS.items())
            ]  # fmt: skip
        for prefix, number, count, trial_run in ways:
            results[prefix + name] = []
            for i, trial in enumerate(trials[:count]):
                progress(prefix + name, done / total)
                compute = partial(trial_run, trial)
                results[prefix + name].append(cache.get(10**6 * number + i, compute))
                done += 1
    plots = {"peaks": lambda: _plot(results), "curves": lambda: curves(first_of_each(drawn["off"]))}
    return Outcome(tuple(_rows(results)), plots)


def _rows(results: dict[str, list[dict[str, Any]]]) -> list[Row]:
    off, search, near = (results[name] for name, _, _ in GROUPS)
    every = [*off, *search, *near]
    rows = [
        _share("inserted", "fully in, and said so", "5 mm, 5 deg", off, 0.97, 0.99),
        _share("searched", "fully in by force alone", "8 mm, 3 deg", search, 0.95, 0.99),
        _share("near_inserted", "fully in, and said so", "1.5 mm, 1 deg", near, None, None),
        *(
            _share(f"{prefix}{key}", what, condition, results[prefix + name], None, None)
            for prefix, what in (
                ("paper_", "the paper's way"),
                ("ablation_stiff_tilt_", "ours, but the arm does not yield in tilt"),
                ("ablation_no_search_", "ours, but without the spiral"),
            )
            for key, condition, name in (
                ("inserted", "5 mm, 5 deg", "off"),
                ("near_inserted", "1.5 mm, 1 deg", "near"),
            )
        ),
    ]
    partial_ones = sum(r["partial_as_success"] for r in every)
    rows.append(
        Row(
            "partial_as_success",
            "said to be seated, and not fully in",
            "all",
            partial_ones,
            n=len(every),
            must=0,
            aim=0,
        )
    )
    halted = [*results["paper_off"], *results["paper_near"]]
    rows.append(
        Row(
            "paper_partial_as_success",
            "the paper's way: halted in the socket, not fully in",
            "both",
            sum(r["partial_as_success"] for r in halted),
            n=len(halted),
        )
    )
    stiff = results["ablation_stiff_tilt_off"]
    for key, what in (("axial_n", "axial"), ("lateral_n", "lateral")):
        say = f"{what} force without yielding in tilt, 99th percentile of the peaks"
        peaks = [r[key] for r in stiff]
        rows.append(_peak(f"ablation_stiff_tilt_{key}", say, "5 mm, 5 deg", peaks))
    for key, what, must, aim in (("axial_n", "axial", 110, 90), ("lateral_n", "lateral", 50, 40)):
        say = f"{what} force, 99th percentile of the peaks"
        peaks = [r[key] for r in [*off, *search]]
        rows.append(_peak(key, say, "5 mm, 5 deg and 8 mm, 3 deg", peaks, must, aim))
    times = [r["seconds"] for r in off if r["full"] and r["said"]]
    if times:
        rows.append(
            Row(
                "insert_seconds",
                "from 15 mm before the face to seated, median",
                "5 mm, 5 deg",
                float(np.median(times)),
                "s",
                len(times),
                low=float(np.min(times)),
                high=float(np.max(times)),
            )
        )
    out = [r for r in every if "unplugged" in r]
    good = sum(r["unplugged"] for r in out)
    what = "of those plugged in"
    rows.append(share_row("unplugged", what, "all", good, len(out), None, 0.99, 0.995, "higher"))
    rows.append(
        Row(
            "unplug_n",
            "greatest force with which the socket held a plug that was pulled",
            "all",
            max((r["unplug_n"] for r in out), default=float("nan")),
            "N",
            len(out),
            must=125,
            aim=110,
        )
    )
    rows.append(
        Row(
            "sunk_mm",
            "deepest overlap of plug and socket",
            "all",
            max(r["sunk_mm"] for r in every),
            "mm",
            len(every),
        )
    )
    return rows


def _peak(
    key: str,
    say: str,
    condition: str,
    peaks: list[float],
    must: float | None = None,
    aim: float | None = None,
) -> Row:
    """99th percentile of forces [N], with their median and greatest."""
    return Row(
        key,
        say,
        condition,
        float(np.percentile(peaks, 99)),
        "N",
        len(peaks),
        low=float(np.median(peaks)),
        high=float(np.max(peaks)),
        must=must,
        aim=aim,
    )


def _share(
    key: str,
    what: str,
    condition: str,
    some: list[dict[str, Any]],
    must: float | None,
    aim: float | None,
) -> Row:
    good = sum(bool(r["full"] and r["said"]) for r in some)
    return share_row(key, what, condition, good, len(some), None, must, aim, "higher")


def _plot(results: dict[str, list[dict[str, Any]]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.5))
    for i, key in enumerate(("axial_n", "lateral_n")):
        axes = figure.add_subplot(1, 2, i + 1)
        for name, some in results.items():
            values = np.sort([r[key] for r in some])
            axes.plot(values, np.linspace(0, 1, len(values)), label=name)
        axes.set_xlabel(f"peak {key[:-2]} force [N]")
        axes.set_ylabel("share of trials below")
        axes.legend(fontsize=7)
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "insertion", "Plugging in and out by force, in contact physics", run, runs=100, about=ABOUT
)
