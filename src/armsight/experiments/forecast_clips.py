"""Recorded people as occupancy, and the forecast judged on them, cross-validated by clip."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from armsight.arrays import Bytes, Floats, Ints, Mask, Points, Vector3
from armsight.errors import ArmsightError
from armsight.mapping.danger import danger
from armsight.mapping.forecast import (
    FEATURES,
    LENGTHS,
    ForecastModel,
    OccupancyForecast,
    fit_model,
)
from armsight.mapping.snapshot import VoxelGrid
from armsight.simulation.clips import Clip, load_clip
from armsight.simulation.skeleton import INDEX, PARTS

GRID = VoxelGrid(np.array([0.4, -1.2, 0.0]), 0.05, (48, 48, 40))
"""Where the recorded people are; T2's voxels of 5 cm. The clips' robot stands at the origin."""
RATE = 10.0
"""Occupancy is sampled so often [Hz]."""
HORIZON = 2.0
"""Forecast this far [s]."""
WARM_UP = 1.0
"""No forecast is judged before this much of a clip was seen [s]."""
EVERY = 4
"""One forecast in so many samples is judged."""
NEAR = 0.7
"""Voxels up to this far from the person are judged [m], and one in twenty of the rest: far from
everybody any forecast is right."""
SAMPLES = 1500
"""Voxels judged at a time, drawn at random."""
FIT_SHARE = 0.15
"""Share of the samples that each fit uses: plenty for seven weights."""
RADII = {
    "torso": 0.15,
    "head": 0.11,
    "upper_arm": 0.055,
    "forearm": 0.045,
    "hand": 0.045,
    "thigh": 0.08,
    "shin": 0.06,
    "foot": 0.05,
}
"""Body parts as capsules [m]."""


def find_clips() -> list[Path]:
    """The recorded clips beside the project.

    Raises:
        ArmsightError: there are none.
    """
    for parent in (Path.cwd(), *Path(__file__).resolve().parents):
        for folder in (parent / "shared", parent.parent / "shared"):
            found = sorted((folder / "data/motion/human_motion").glob("*/*.csv.gz"))
            if found:
                return found
    raise ArmsightError(
        "the recorded people are missing: put them into ../shared/data/motion/human_motion"
    )


def body_occupancy(joints: Points, grid: VoxelGrid = GRID) -> Mask:
    """(nx, ny, nz) voxels that a person's capsules touch (by the voxel's inscribed ball)."""
    occupied = np.zeros(grid.shape, bool)
    for name, start, end, _ in PARTS:
        radius = RADII[name.removeprefix("left_").removeprefix("right_")] + 0.5 * grid.voxel
        a, b = joints[INDEX[start]], joints[INDEX[end]]
        low = np.maximum(grid.index((np.minimum(a, b) - radius)[None])[0], 0)
        high = np.minimum(grid.index((np.maximum(a, b) + radius)[None])[0] + 1, grid.shape)
        if (low >= high).any():
            continue
        ranges = [np.arange(i, j) for i, j in zip(low, high)]
        index = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1)
        inside = _segment_distance(grid.center(index.reshape(-1, 3)), a, b) < radius
        block = tuple(slice(i, j) for i, j in zip(low, high))
        occupied[block] |= inside.reshape(index.shape[:3])
    return occupied


def _segment_distance(points: Points, a: Vector3, b: Vector3) -> Floats:
    d = b - a
    t = np.clip(((points - a) @ d) / max(float(d @ d), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - t[:, None] * d, axis=1))


@dataclass(frozen=True)
class Samples:
    """Forecasts to be judged.

    Attributes:
        features: (n, 7) of our forecast; paper: (n,) T2's danger.
        occupied: (n,) whether occupied at the time; outcome: (n,) whether within the horizon.
        clip: (n,) index of the clip.
    """

    features: Floats
    paper: Floats
    occupied: Bytes
    outcome: Bytes
    clip: Ints


def samples_of(clip: Clip, number: int, rng: np.random.Generator) -> Samples:
    """Watch one clip as a map of perfect sight would, and note what was to be forecast."""
    step = max(round(clip.rate / RATE), 1)
    frames = np.array([body_occupancy(j) for j in clip.joints[::step]])
    dt = step / clip.rate
    ahead = round(HORIZON / dt)
    forecast = OccupancyForecast(GRID)
    last = np.full(GRID.shape, -np.inf)
    everything = np.ones(GRID.shape, np.uint8)
    parts: list[tuple[Floats, Floats, Bytes, Bytes]] = []
    for k, now in enumerate(frames):
        forecast.observe(now, everything, k * dt)
        last[now] = k * dt
        if k * dt < WARM_UP or k % EVERY or k + ahead >= len(frames) or not now.any():
            continue
        features = forecast.features()
        near = features[..., 2 + len(LENGTHS)] > np.exp(-NEAR / LENGTHS[-1])
        chosen = np.flatnonzero((near | (rng.random(GRID.shape) < 0.05)).reshape(-1))
        chosen = rng.choice(chosen, min(len(chosen), SAMPLES), replace=False)
        outcome = frames[k + 1 : k + ahead + 1].any(axis=0)
        parts.append(
            (
                features.reshape(-1, len(FEATURES))[chosen],
                danger((k * dt - last).reshape(-1)[chosen]),
                now.reshape(-1)[chosen].astype(np.uint8),
                outcome.reshape(-1)[chosen].astype(np.uint8),
            )
        )
    if not parts:
        empty = np.zeros(0)
        none = np.zeros(0, np.uint8)
        return Samples(np.zeros((0, len(FEATURES))), empty, none, none, np.zeros(0, np.int64))
    features, paper, occupied, outcomes = (
        np.concatenate([part[column] for part in parts]) for column in range(4)
    )
    return Samples(features, paper, occupied, outcomes, np.full(len(paper), number))


def gather(
    paths: Sequence[Path], seed: int, progress: Callable[[str, float], None]
) -> tuple[Samples, list[str]]:
    """Samples of all clips and their names."""
    rng = np.random.default_rng(seed)
    names, found = [], []
    for number, path in enumerate(paths):
        clip = load_clip(path)
        progress(f"watch {clip.name}", number / len(paths))
        names.append(clip.name)
        found.append(samples_of(clip, number, rng))
    return (
        Samples(
            *(
                np.concatenate([getattr(s, name) for s in found])
                for name in ("features", "paper", "occupied", "outcome", "clip")
            )
        ),
        names,
    )


def fit(samples: Samples, chosen: Mask | None = None) -> ForecastModel:
    """The model of the chosen samples (all if absent)."""
    c = np.ones(len(samples.paper), bool) if chosen is None else chosen
    return fit_model(samples.features[c], samples.occupied[c], samples.outcome[c], HORIZON)


def cross_validated(samples: Samples, rng: np.random.Generator) -> Floats:
    """(n,) forecasts, each by a model that has not seen its clip."""
    out = np.zeros(len(samples.paper))
    for clip in np.unique(samples.clip):
        test = samples.clip == clip
        model = fit(samples, ~test & (rng.random(len(test)) < FIT_SHARE))
        out[test] = model.probability(samples.features[test], samples.occupied[test])
    return out


def auc(forecast: Floats, outcome: Bytes) -> float:
    """Area under the receiver's curve: how often a hit ranks above a miss."""
    y = np.asarray(outcome) != 0
    ranks = rankdata(forecast)
    hits, misses = int(y.sum()), int((~y).sum())
    if hits == 0 or misses == 0:
        return float("nan")
    return float((ranks[y].sum() - hits * (hits + 1) / 2) / (hits * misses))


def brier(forecast: Floats, outcome: Bytes) -> float:
    """Mean squared error of probabilities."""
    return float(np.mean((forecast - (np.asarray(outcome) != 0)) ** 2))
