"""Rows, notes and plot of ``servo-ball``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armsight.experiments.recorded_hands import PLAYS
from armsight.experiments.rows import Row, bootstrap, wilson
from armsight.experiments.servo_nudges import HARM
from armsight.experiments.servo_rows import harm_row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Found: TypeAlias = dict[tuple[str, str], list[dict[str, Any]]]
"""Trials by the prefix of their keys and what the ball does."""


def ball_rows(results: Found) -> list[Row]:
    """Ours, then V's modes."""
    return [*_ours(results), *_papers(results)]


def _success(
    key: str, condition: str, found: Sequence[dict[str, Any]], paper: float | None, ours: bool
) -> Row:
    good = sum(r["reached"] for r in found)
    low, high = wilson(good, len(found))
    return Row(
        key,
        "share of trials in which the tip came within 5 mm of the ball's surface, 95 % by Wilson",
        condition,
        good / max(len(found), 1),
        n=len(found),
        low=low,
        high=high,
        paper=paper,
        must=(0.95 if key.startswith("held_") else 0.97) if ours else None,
        aim=0.99 if ours else None,
        better="higher",
    )


def _time(
    key: str,
    condition: str,
    found: Sequence[dict[str, Any]],
    paper: float | None,
    budget: tuple[float, float] | None,
) -> Row:
    times = [r["seconds"] for r in found if r["reached"]]
    low, high = bootstrap(times, np.random.default_rng(0), "median")
    return Row(
        key,
        "median time to within 5 mm, of the trials that got there; 95 % by bootstrap",
        condition,
        float(np.median(times)) if times else math.nan,
        "s",
        len(times),
        low,
        high,
        paper,
        None if budget is None else budget[0],
        None if budget is None else budget[1],
        why="no trial got there",
    )


def _ours(results: Found) -> list[Row]:
    rest, moving, t2 = results[("", "rest")], results[("", "moving")], results[("t2", "rest")]
    hands, near = results[("", "recorded")], [r for r in moving if 0.15 <= r["speed"] <= 0.25]
    held, led = results[("held_", "rest")], results[("held_", "recorded")]
    full, less = "speed 1, acceleration 1", "speed 0.5, acceleration 0.6"
    stands = [*rest, *moving, *hands, *t2]
    persons = [*held, *led]
    return [
        _success("ball_success", f"at rest, {full}", rest, 0.95, True),
        _success("ball_success", f"moving at up to 0.1-0.4 m/s, {full}", moving, None, True),
        _success("ball_success", f"recorded hands, {full}", hands, None, True),
        _success("ball_success", f"at rest, {less}", t2, 0.95, True),
        _success("held_ball_success", f"held still, {full}", held, 0.95, True),
        _success("recorded_held_ball_success", f"by people as recorded, {full}", led, None, False),
        _time("ball_time_s", f"at rest, {full}", rest, 9.0, (4.0, 1.8)),
        _time("ball_time_s", f"at rest, {less}", t2, 9.0, (4.0, 1.8)),
        _time("ball_moving_time_s", f"at up to 0.15-0.25 m/s, {full}", near, None, (4.0, 2.5)),
        _time("held_ball_time_s", f"held still, {full}", held, 9.0, (6.0, 4.0)),
        harm_row(HARM, "all of ours, on a stand", sum(r["harm"] for r in stands), len(stands)),
        harm_row(
            "trials in which the ball was pressed above the permit, or the holder was touched",
            "all of ours, held",
            sum(r["harm"] for r in persons),
            len(persons),
        ),
        _force("ball_force_n", "ours, on a stand", stands),
        _force("held_ball_force_n", "ours, held", persons),
        Row(
            "permit_ended_pushing",
            "trials in which a permit ended in contact and the tip still pushed in before it stood",
            "all of ours, on a stand",
            float(sum(r["after"] > 0 for r in stands)),
            n=len(stands),
        ),
        Row(
            "press_mm",
            "median of the deepest overlap within 0.3 s of the touch: how hard it would press",
            "ours, at rest",
            1e3 * float(np.median([max(r["press"], 0.0) for r in rest if r["reached"]] or [0.0])),
            "mm",
            len(rest),
        ),
    ]


def _force(key: str, condition: str, found: Sequence[dict[str, Any]]) -> Row:
    say = "greatest force on the ball, of all trials"
    force = max((r["force"] for r in found), default=math.nan)
    return Row(key, say, condition, force, "N", len(found))


def _papers(results: Found) -> list[Row]:
    paper, fixed = results[("paper_", "rest")], results[("fixed_", "rest")]
    where = "V's errors, at rest"
    share = sum(r["reached"] for r in paper) / max(len(paper), 1)
    rows = [
        _success("paper_ball_success", where, paper, 0.95, False),
        _success("fixed_ball_success", where, fixed, 0.68, False),
        _time("paper_ball_time_s", where, paper, 9.0, None),
        _time("fixed_ball_time_s", where, fixed, 10.2, None),
        Row(
            "paper_mode_gap",
            "share of successes of V's mode less V's figure, absolute",
            where,
            abs(share - 0.95),
            n=len(paper),
            must=0.10,
            aim=0.05,
        ),
    ]
    for key, found, figure in (("paper_", paper, 11.0), ("fixed_", fixed, 12.0)):
        steps = [float(r["iterations"]) for r in found if r["reached"]]
        rows.append(
            Row(
                f"{key}ball_iterations",
                "median number of segments",
                where,
                float(np.median(steps)) if steps else math.nan,
                n=len(steps),
                paper=figure,
                why="no trial got there",
            )
        )
    return rows


def notes(results: Found) -> tuple[str, ...]:
    """What belongs beside the table."""
    said = []
    for (prefix, motion), found in results.items():
        lost = [r for r in found if not r["reached"]]
        if lost:
            words = "; ".join(_why(r) for r in lost[:6])
            said.append(
                f"Not reached, {prefix or 'ours'} {motion}: {len(lost)} of {len(found)}: {words}."
            )
    hands = results[("", "recorded")]
    speeds = sorted(r["speed"] for r in hands) or [math.nan]
    soon = sum(r["reached"] and r["seconds"] < PLAYS for r in hands)
    said.append(
        f"Recorded hands move at up to {speeds[0]:.1f} to {speeds[-1]:.1f} m/s, "
        f"{float(np.median(speeds)):.1f} in the median trial; {soon} of {len(hands)} are touched "
        "before they slow down to rest."
    )
    shown = [r for (prefix, _), found in results.items() if prefix == "rendered_" for r in found]
    if shown:
        factor = float(np.median([r["factor"] for r in shown]))
        said.append(f"Rendered trials ran at {factor:.2f} of real time in the median.")
    held = [*results[("held_", "rest")], *results[("held_", "recorded")]]
    nearest = min((r["apart"] for r in held), default=math.nan)
    heads = sum(r["heads"] > 0 for r in held)
    said.append(
        f"Of who holds the ball the arm came within {nearest:.2f} m at the nearest, the hand that "
        f"holds it included; in {heads} of {len(held)} trials their head reached into the permit's "
        "region."
    )
    said.append(
        "V's arm stopped about a second for each segment; here segments follow each other within "
        "30 ms, so V's modes take less time than V reports at about as many segments."
    )
    return tuple(said)


def _why(trial: dict[str, Any]) -> str:
    """Why a trial did not get there; that a permit was granted says nothing of it."""
    permit = trial.get("permit", "")
    words = trial["last"] if permit.endswith("granted") and trial["last"] else permit
    clip = f", {trial['clip']}" if trial.get("clip") else ""
    height = f", the ball at {trial['height']:.2f} m" if "height" in trial else ""
    away = f"{1e3 * trial['away']:.0f} mm away"
    return f"{away} ({words or trial['last'] or 'no reason'}{clip}{height})"


def times(results: Found, limit: float) -> Figure:
    """Share of trials that touched, over the time [s] until they are given up."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.6))
    axes = figure.subplots()
    names = {
        "": "ours", "held_": "ours, held", "t2": "ours, T2's shares", "paper_": "V's hybrid",
        "fixed_": "V's, fixed", "rendered_": "ours, rendered",
    }  # fmt: skip
    for (prefix, motion), found in results.items():
        seconds = np.sort([r["seconds"] if r["reached"] else np.inf for r in found])
        share = np.arange(1, len(seconds) + 1) / len(seconds)
        axes.step(seconds, share, where="post", label=f"{names[prefix]}, {motion}")
    axes.set_xlim(0, limit)
    axes.set_ylim(0, 1)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("share of trials that touched")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    return figure
