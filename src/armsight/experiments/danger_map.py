"""``danger-map``: T2's three circles, its decay at any rate, and the forecast beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import Bytes, Floats
from armsight.experiments.forecast_clips import (
    HORIZON,
    Samples,
    auc,
    brier,
    cross_validated,
    find_clips,
    fit,
    gather,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.mapping.danger import ALPHA, PAPER_ALPHA, PaperDecay, danger, decay_time

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RADII = (0.20, 0.32, 0.46)
"""Of T2's circles [m]."""
PERIODS = (9.1, 14.69, 21.06)
"""Time for one round of each [s]."""
BANDS = ((0.5, 1.0), (0.2, 0.5), (0.0, 0.2))
"""Mean costs that T2 prints for them."""
ALONG = 0.10
"""The object's edge along its way [m]; the other two are 10 and 20 cm, either upright."""
VOXEL = 0.05
"""Edge of T2's voxels [m]."""
PAPER_DT = 0.68
"""Time between updates at which alpha 0.3 takes 24.48 s, counting the step that sets 0.999 [s]."""
RATES = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0)
"""Frame rates at which the decay is timed [Hz]."""

ABOUT = """
**Circles.** An object of 10 x 20 cm moves on circles of 20, 32 and 46 cm about one centre, in
9.1, 14.69 and 21.06 s (the same speed of 0.14 m/s), one after another, 20 times. T2's rule is
applied to 5 cm voxels every 0.68 s, and the mean of C over the whole experiment is taken for every
voxel, as T2 says. T2 prints 0.5-1.0, 0.2-0.5 and 0.0-0.2 for the inner, middle and outer circle.

These cannot be means of C along circles that are all seen: a voxel visited once in a round of
44.85 s has C > 0.9 for three quarters of 21 to 24 s after each visit, wherever it lies, so its mean
is near 0.5 on every circle, and more where the object sweeps voxels of two circles. T2 leaves open
how the object stood, and says that its arm hid the inner area from the cameras while the outer
circle was driven. What is not seen does not decay; so we read it three ways: the long edge across
its way; the long edge upright; and upright with all inside the inner circle's rim unseen during the
outer circle (an upper bound: an arm hides a sector, not all). The last gives T2's inner band, and
the middle one but for 0.004. None gives its outer one, and none can: a mean of 0.2 needs 113 s
between visits, and the outer circle is driven every 44.85 s. `band_interval_s` is that time for the
red and the orange band.

**Decay.** Time from the last sight of an object until C = 0, read from the age (closed form) and
stepped by T2's rule, at frame rates from 5 to 120 Hz.

**Forecast.** 28 recorded people (Vicon, nine segments) as 5 cm voxels at 10 Hz. Every 0.4 s, for
voxels up to 0.7 m from the person and a twentieth of the rest, which are free at that time: will it
be occupied within 2 s? T2's C read as a probability against the forecast of `mapping/forecast.py`,
whose seven weights are fitted on the other 27 clips each time. AUC: how often a voxel that will be
occupied ranks above one that will not. Brier: mean squared error of the probability.
"""


@dataclass(frozen=True)
class Reading:
    """One way to read what T2 leaves open.

    Attributes:
        name: for people.
        across: the object's edge across its way, in the plane of the circles [m].
        hidden: whether the inner area is unseen while the outer circle is driven.
    """

    name: str
    across: float
    hidden: bool


READINGS = (
    Reading("20 cm across its way", 0.20, False),
    Reading("20 cm upright", 0.10, False),
    Reading("20 cm upright, inner area hidden", 0.10, True),
)
"""Ours of T2's circles."""


@dataclass(frozen=True)
class Circles:
    """Mean danger of a plane of voxels.

    Attributes:
        x, y: (n, n) centres [m]; mean: (n, n) mean C over the experiment.
        rounds: driven.
        reading: of T2.
    """

    x: Floats
    y: Floats
    mean: Floats
    rounds: int
    reading: Reading

    def on(self, radius: float) -> Floats:
        """Mean C of the voxels that the circle's line runs through."""
        return np.asarray(self.mean[np.abs(np.hypot(self.x, self.y) - radius) < 0.5 * VOXEL])


def drive_circles(
    rounds: int, reading: Reading, dt: float = PAPER_DT, alpha: float = PAPER_ALPHA
) -> Circles:
    """T2's danger-map experiment on exact occupancy, seen at 15 Hz and decayed every ``dt`` [s]."""
    n = round(1.4 / VOXEL)
    edge = (np.arange(n) + 0.5) * VOXEL - 0.5 * n * VOXEL
    x, y = np.meshgrid(edge, edge, indexing="ij")
    inner = np.hypot(x, y) < RADII[0] + 0.5 * reading.across
    rule = PaperDecay(x.shape, dt, alpha)
    total = np.zeros(x.shape)
    steps = 0
    seen = np.zeros(x.shape, np.uint8)
    time, due = 0.0, 0.0
    frame = 1.0 / 15.0
    for _ in range(rounds):
        for radius, period in zip(RADII, PERIODS):
            unseen = inner & (reading.hidden and radius == RADII[-1])
            for k in range(round(period / frame)):
                seen |= _object(x, y, radius, 2 * np.pi * k * frame / period, reading.across)
                time += frame
                if time >= due:
                    due += dt
                    kept = rule.danger[unseen]
                    rule.update(seen)
                    rule.danger[unseen] = kept
                    seen[:] = 0
                    total += rule.danger
                    steps += 1
    return Circles(x, y, total / max(steps, 1), rounds, reading)


def _object(x: Floats, y: Floats, radius: float, angle: float, edge: float) -> Bytes:
    """Voxels whose centre the object covers; ``edge`` is the one across its way [m]."""
    dx, dy = x - radius * np.cos(angle), y - radius * np.sin(angle)
    across = dx * np.cos(angle) + dy * np.sin(angle)
    along = dy * np.cos(angle) - dx * np.sin(angle)
    inside = (np.abs(along) <= 0.5 * ALONG) & (np.abs(across) <= 0.5 * edge)
    return inside.astype(np.uint8)


def mean_between_visits(interval: float, stay: float = 0.7, alpha: float = ALPHA) -> float:
    """Mean C of a voxel that is visited every ``interval`` [s] for ``stay`` [s]."""
    ages = np.linspace(0.0, max(interval - stay, 0.0), 4000)
    away = max(interval - stay, 0.0) * float(danger(ages, alpha).mean())
    return (min(stay, interval) * 0.999 + away) / interval


def decay_times(rates: tuple[float, ...] = RATES) -> tuple[Floats, Floats]:
    """Time until C = 0 at each frame rate [s]: by age, and stepped by T2's rule."""
    by_age, stepped = [], []
    for rate in rates:
        ages = np.arange(0, 40 * rate) / rate
        # The time at which C first is 0, not the frame that notices it: between two frames.
        last = int(np.flatnonzero(danger(ages) > 0)[-1])
        low, high = ages[last], ages[last + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if danger(np.array([middle]))[0] > 0 else (low, middle)
        by_age.append(high)
        stepped.append(PaperDecay((1,), 1.0 / rate).steps_to_zero() / rate)
    return np.array(by_age), np.array(stepped)


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """Drive the circles ``runs`` rounds, time the decay, judge the forecast."""
    progress("circles", 0.0)
    circles = [drive_circles(runs, reading) for reading in READINGS]
    by_age, stepped = decay_times()
    samples, names = gather(find_clips(), seed, lambda s, d: progress(s, 0.1 + 0.6 * d))
    progress("fit and judge, clip by clip", 0.7)
    ours = cross_validated(samples, np.random.default_rng(seed))
    model = fit(samples)
    rows = [*_circle_rows(circles), *_decay_rows(by_age, stepped), *_forecast_rows(samples, ours)]
    weights = ", ".join(f"{w:.3f}" for w in model.weights)
    notes = (
        "T2's bands (inner 0.5-1.0, middle 0.2-0.5, outer 0.0-0.2) are not reproduced: if the "
        "object stood upright and the arm hid the inner area, as T2 says it did, the inner one "
        "comes out and the middle one nearly does; the outer one does not, and cannot for a circle "
        "that is seen and driven once in 44.85 s.",
        f"Weights fitted to all {len(names)} clips: {weights}; "
        f"a voxel occupied now stays or is occupied again with {model.stays:.3f}.",
    )
    plots = {
        "circles": lambda: _plot_circles(circles),
        "decay": lambda: _plot_decay(),
        "forecast": lambda: _plot_forecast(samples, ours),
    }
    return Outcome(tuple(rows), plots, notes)


def _circle_rows(driven: Sequence[Circles]) -> list[Row]:
    rows = []
    for circles in driven:
        for radius, band in zip(RADII, BANDS):
            values = circles.on(radius)
            low, high = np.percentile(values, [10, 90])
            rows.append(
                Row(
                    "circle_mean_cost",
                    "mean C along the circle, 10 to 90 % of its voxels; T2 prints 0.5-1.0, "
                    "0.2-0.5, 0.0-0.2 for 20, 32, 46 cm",
                    f"{100 * radius:.0f} cm (T2: {band[0]}-{band[1]}), {circles.reading.name}",
                    float(values.mean()),
                    n=len(values),
                    low=float(low),
                    high=float(high),
                )
            )
    for level, name in ((0.5, "red"), (0.2, "orange")):
        rows.append(
            Row(
                "band_interval_s",
                "longest time between visits at which mean C still reaches the band",
                f"{name}, C >= {level}",
                _longest(level),
                "s",
            )
        )
    return rows


def _longest(level: float) -> float:
    low, high = 1.0, 400.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mean_between_visits(middle) >= level else (low, middle)
    return low


def _decay_rows(by_age: Floats, stepped: Floats) -> list[Row]:
    rates = f"{RATES[0]:.0f} to {RATES[-1]:.0f} Hz"
    return [
        Row(
            "decay_s",
            "time from occupied to C = 0, by age",
            rates,
            float(by_age.mean()),
            "s",
            n=len(by_age),
            low=float(by_age.min()),
            high=float(by_age.max()),
            paper=24.48,
        ),
        Row(
            "decay_spread",
            "greatest deviation of that time from 24.48 s at any rate",
            rates,
            float(np.abs(by_age / 24.48 - 1).max()),
            n=len(by_age),
            must=0.01,
            aim=0.001,
        ),
        Row(
            "decay_paper_s",
            "the same by T2's steps with alpha 0.3",
            rates,
            float(stepped.mean()),
            "s",
            n=len(stepped),
            low=float(stepped.min()),
            high=float(stepped.max()),
            paper=24.48,
        ),
        Row(
            "decay_paper_s",
            "the same, counting the step that sets 0.999",
            f"every {PAPER_DT} s",
            (PaperDecay((1,), PAPER_DT).steps_to_zero() + 1) * PAPER_DT,
            "s",
            paper=24.48,
        ),
    ]


def _forecast_rows(samples: Samples, ours: Floats) -> list[Row]:
    free = samples.occupied == 0
    rows = []
    for mask, condition in (
        (free, "free now"),
        (np.ones(len(free), bool), "free or occupied now"),
    ):
        y, p, t2 = samples.outcome[mask], ours[mask], samples.paper[mask]
        n = int(mask.sum())
        per_clip = [
            auc(ours[mask & (samples.clip == c)], samples.outcome[mask & (samples.clip == c)])
            for c in np.unique(samples.clip)
        ]
        low, high = np.nanpercentile(per_clip, [10, 90])
        paper_auc, paper_brier = auc(t2, y), brier(t2, y)
        first = condition == "free now"
        rows += [
            Row(
                "forecast_auc",
                f"occupied within {HORIZON:.0f} s, ours; 10 to 90 % of the clips",
                condition,
                auc(p, y),
                n=n,
                low=float(low),
                high=float(high),
                must=paper_auc if first else None,
                aim=0.9 if first else None,
                better="higher",
                strict=True,
            ),
            Row("forecast_auc_t2", "the same by T2's danger", condition, paper_auc, n=n),
            Row("forecast_brier", "squared error of the probability", condition, brier(p, y), n=n),
            Row("forecast_brier_t2", "the same of T2's danger", condition, paper_brier, n=n),
            Row(
                "forecast_brier_ratio",
                "ours over T2's",
                condition,
                brier(p, y) / paper_brier,
                n=n,
                must=1.0 if first else None,
                aim=0.6 if first else None,
                strict=True,
            ),
        ]
    return rows


def _plot_circles(driven: Sequence[Circles]) -> Figure:
    from matplotlib import pyplot as plt
    from matplotlib.patches import Circle

    figure, axes = plt.subplots(1, len(driven) + 1, figsize=(5 * len(driven) + 5, 4.6))
    for axis, circles in zip(axes, driven):
        image = axis.pcolormesh(
            100 * circles.x, 100 * circles.y, circles.mean, cmap="YlOrRd", vmin=0, vmax=1
        )
        for radius in RADII:
            axis.add_patch(Circle((0, 0), 100 * radius, fill=False, linewidth=0.8))
        axis.set(aspect="equal", xlabel="x, cm", ylabel="y, cm")
        axis.set_title(f"mean C, {circles.reading.name}")
        figure.colorbar(image, ax=axis)
    axis = axes[-1]
    intervals = np.geomspace(5, 300, 120)
    axis.semilogx(intervals, [mean_between_visits(t) for t in intervals])
    for low, high in BANDS:
        axis.axhspan(low, high, alpha=0.12, color={1.0: "r", 0.5: "orange", 0.2: "g"}[high])
    axis.axvline(sum(PERIODS), linestyle=":", color="k")
    axis.text(1.03 * sum(PERIODS), 0.02, "one round of T2", rotation=90, va="bottom")
    axis.set(xlabel="time between visits, s", ylabel="mean C", title="T2's bands as visit rates")
    figure.tight_layout()
    return figure


def _plot_decay() -> Figure:
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(6.4, 4))
    age = np.linspace(0, 27, 600)
    axis.plot(age, danger(age), label=f"closed form, alpha {ALPHA}: {decay_time():.2f} s")
    for dt in (0.01, 0.68, 1.0):
        rule = PaperDecay((1,), dt)
        rule.update(np.ones(1, np.uint8))
        values = [0.999]
        for _ in range(int(27 / dt)):
            values.append(float(rule.update(np.zeros(1, np.uint8))[0]))
        axis.plot(np.arange(len(values)) * dt, values, "--", label=f"T2's steps of {dt} s")
    axis.set(xlabel="time since last occupied, s", ylabel="danger C")
    axis.legend()
    figure.tight_layout()
    return figure


def _plot_forecast(samples: Samples, ours: Floats) -> Figure:
    from matplotlib import pyplot as plt

    free = samples.occupied == 0
    y = samples.outcome[free] != 0
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4))
    for name, p in (("ours", ours[free]), ("T2's danger", samples.paper[free])):
        order = np.argsort(-p, kind="stable")
        hits = np.cumsum(y[order]) / y.sum()
        misses = np.cumsum(~y[order]) / (~y).sum()
        pick = np.unique(np.linspace(0, len(hits) - 1, 2000).astype(int))
        axes[0].plot(misses[pick], hits[pick], label=f"{name}, AUC {auc(p, y):.3f}")
        edges = np.unique(np.quantile(p, np.linspace(0, 1, 25)))
        group = np.clip(np.searchsorted(edges, p, side="right") - 1, 0, max(len(edges) - 2, 0))
        count = np.maximum(np.bincount(group), 1)
        axes[1].plot(np.bincount(group, p) / count, np.bincount(group, y) / count, "o-", label=name)
    axes[0].set(xlabel="false alarms", ylabel="hits", title="occupied within 2 s")
    axes[1].plot([0, 1], [0, 1], ":", color="k")
    axes[1].set(xlabel="forecast", ylabel="happened", title="reliability")
    for axis in axes:
        axis.legend()
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "danger-map",
    "T2: danger map of three circles; decay at any rate; forecast of the next 2 s",
    run,
    runs=20,
    about=ABOUT,
)
"""See the module."""
