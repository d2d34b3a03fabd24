"""Rows and plots of ``servo-accuracy``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments.rows import Row, bootstrap
from armsight.experiments.servo_nudges import HARM
from armsight.experiments.servo_rows import harm_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def accuracy_rows(found: dict[str, list[Any]], runs: int, near: float) -> list[Row]:
    """What each part found; an estimate within ``near`` [m] of the target has it."""
    rng = np.random.default_rng(0)

    def median_of(samples: Sequence[float]) -> tuple[float, float, float]:
        low, high = bootstrap(samples, rng, "median")
        return float(np.median(samples)), low, high

    rows = []
    say = "median distance of the estimate from the joints' place of the tip, 0.1 m/s, over runs"
    for key, name, where, must, aim in (
        ("fixed_mm", "fixed", "ours, the cell's errors", 12.0, 6.0),
        ("ablation_fixed_mm", "fixed_v_errors", "ours, V's errors", None, None),
        ("paper_fixed_mm", "paper_fixed", "V's mode, V's errors", None, None),
    ):
        value, low, high = median_of([float(np.median(r)) for r in found[name] if r])
        rows.append(Row(key, say, where, value, "mm", runs, low, high, 38.0, must, aim))
    say = (
        "distance of the pair's place of a bulls-eye at rest from where the joints touch it, median"
    )
    for key, name, where, must, aim in (
        ("pair_mm", "pair", "ours, the cell's errors", 3.0, 1.5),
        ("ablation_pair_mm", "pair_v_errors", "ours, V's errors", None, None),
        ("paper_pair_mm", "paper_pair", "V's mode, V's errors", None, None),
    ):
        each = [mm for r in found[name] for mm in r]
        value, low, high = median_of(each)
        rows.append(Row(key, say, where, value, "mm", len(each), low, high, 18.0, must, aim))
    say = "rms error of the tip behind a ball on a circle of 0.2 m, 0.25 m/s, after 3 s; median run"
    for key, name, where, must, aim in (
        ("tracking_rms_mm", "track", "ours", 12.0, 6.0),
        ("touching_rms_mm", "touch", "ours, at the surface", None, None),
        ("ablation_tracking_rms_mm", "track_no_feed", "no feed-forward", None, None),
        ("ablation_tracking_rms_mm", "track_no_bias", "no biases", None, None),
    ):
        value, low, high = median_of([1e3 * r["rms"] for r in found[name]])
        rows.append(Row(key, say, where, value, "mm", runs, low, high, None, must, aim))
    again = [1e3 * t for r in found["gaps"] for t in r["again"]]
    rows.append(
        Row(
            "reacquire_ms",
            "95 % of: how long the estimate was still off by more than "
            f"{1e3 * near:.0f} mm, after 0.5 s without a picture",
            "ours, 0.25 m/s",
            float(np.percentile(again, 95)),
            "ms",
            len(again),
            must=250.0,
            aim=150.0,
        )
    )
    for prefix, name, who in (("", "border", "ours"), ("paper_", "paper_border", "V's mode")):
        ours = prefix == ""
        value, low, high = median_of([r["switches"] for r in found[name]])
        rows.append(
            Row(
                f"{prefix}switches_per_s",
                "changes of the leading sensor, the ball across a border four times in 7 s",
                who,
                value,
                "1/s",
                runs,
                low,
                high,
                must=1.0 if ours else None,
                aim=0.5 if ours else None,
            )
        )
        jumps = [1e3 * j for r in found[name] for j in r["jumps"]]
        rows.append(
            Row(
                f"{prefix}switch_jump_mm",
                "95 % of the jump of the place that is servoed to, within two rounds of such a "
                "change, less the ball's motion",
                who,
                float(np.percentile(jumps, 95)) if jumps else math.nan,
                "mm",
                len(jumps),
                must=2.0 if ours else None,
                aim=1.0 if ours else None,
                why="no change",
            )
        )
        others = [1e3 * j for r in found[name] for j in r["others"]]
        rows.append(
            Row(
                f"{prefix}look_jump_mm",
                "the same in every other round in which a camera showed the ball",
                who,
                float(np.percentile(others, 95)) if others else math.nan,
                "mm",
                len(others),
                why="never seen",
            )
        )
    harm = sum(r["harm"] for name in ("track", "touch", "gaps") for r in found[name])
    return [*rows, harm_row(HARM, "all of ours", harm, 3 * runs)]


def following(found: dict[str, list[Any]]) -> Figure:
    """The first run's circle from the front, and its error over time, seen all along or not."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    path, error = figure.subplots(1, 2, width_ratios=(1, 2))
    for name, label in (("track", "seen all along"), ("gaps", "hidden for 0.5 s in every 2 s")):
        table = np.array(found[name][0]["drawn"])
        time, tip, goal = table[:, 0], table[:, 1:4], table[:, 4:7]
        if name == "track":
            path.plot(goal[:, 1], goal[:, 2], color="0.7", lw=3, label="where it should be")
            path.plot(tip[:, 1], tip[:, 2], lw=0.9, label="the tip")
        error.semilogy(time, 1e3 * np.linalg.norm(tip - goal, axis=1), lw=0.9, label=label)
    for i in range(4):
        error.axvspan(3.0 + 2.0 * i, 3.5 + 2.0 * i, color="0.92")
    error.axhline(12.0, color="0.6", lw=0.8)
    path.set(xlabel="y [m]", ylabel="z [m]", aspect="equal")
    error.set(xlabel="[s]", ylabel="tip from where it should be [mm]")
    path.legend(fontsize=7, loc="center")
    error.legend(fontsize=7)
    return figure


def at_the_border(found: dict[str, list[Any]]) -> Figure:
    """Where the ball is taken to be while it leaves the pair's view, and which sensor leads."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    ways = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (name, title) in zip(ways, (("border", "ours"), ("paper_border", "V's mode"))):
        table = np.array(found[name][0]["drawn"])
        near = table[:, 3] > 2.5
        axes.plot(table[:, 0], 1e3 * table[:, 1], color="0.5", lw=0.6)
        axes.plot(table[near, 0], 1e3 * table[near, 1], ".", ms=2, label="the pair leads")
        axes.plot(table[~near, 0], 1e3 * table[~near, 1], ".", ms=2, label="fixed cameras")
        axes.set(title=title, xlabel="[s]")
        axes.legend(fontsize=7)
    ways[0].set(ylabel="taken to be beside the ball by [mm]")
    return figure
