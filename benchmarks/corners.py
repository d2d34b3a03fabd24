"""Corner errors on rendered boards under blur, noise and glare: ours beside OpenCV's detectors.

    python benchmarks/corners.py [--boards 60] [--seed 0]

A board that is not found counts as missed, not as an error; corners that a detector gives up are
counted, too.
"""

from __future__ import annotations

import argparse

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.calibration_corner_scenes import DETECTORS, SCENES, scene_run


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(f"{'scene':14s} {'detector':16s} {'found':>7s} {'median':>8s} {'p99':>8s} {'lost':>6s}")
    whole: dict[str, list[Floats]] = {name: [] for name in DETECTORS}
    for scene in SCENES:
        runs = [scene_run(options.seed, scene, k) for k in range(options.boards)]
        for name in DETECTORS:
            seen = [np.array(e, float) for r in runs if (e := r[name]) is not None]
            d = np.concatenate(seen) if seen else np.zeros(0)
            whole[name].append(d)
            _line(scene, name, len(seen) / len(runs), d)
    for name, parts in whole.items():
        _line("together", name, float("nan"), np.concatenate(parts))


def _line(scene: str, name: str, share: float, d: Floats) -> None:
    good = d[np.isfinite(d)]
    lost = 1 - len(good) / max(len(d), 1)
    middle, worst = np.quantile(good, [0.5, 0.99]) if len(good) else (np.nan, np.nan)
    print(f"{scene:14s} {name:16s} {share:7.0%} {middle:8.3f} {worst:8.3f} {lost:6.1%}")


if __name__ == "__main__":
    main()
