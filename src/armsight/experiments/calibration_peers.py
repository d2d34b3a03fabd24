"""Calibration in numbers: against the bound, against OpenCV, honest ellipsoids, chosen views.

Everything runs in the synthetic cell (known truth, the error levels of ``calibration.synthetic``,
corners without images), so that dozens of calibrations fit in minutes. The rendered procedure has
experiments of its own.
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from armsight.calibration.calibrate import (
    calibrate,
)
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom
from armsight.calibration.solver import solve
from armsight.calibration.synthetic import (
    make_cell,
    observe,
    random_views,
)
from armsight.experiments.cache import RunCache
from armsight.experiments.calibration_peers_cell import (
    QUICK,
    bound_errors,
    chosen_views,
    ellipsoids,
    errors,
    raster_views,
    truth_state,
    with_true_lenses,
)
from armsight.experiments.calibration_peers_opencv import against_opencv, opencv_errors
from armsight.experiments.calibration_peers_rows import COUNTS, FULL, Run, outcome
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.robots import load_robot


def one(seed: int, full: bool) -> Run:
    """All figures of one seed; ``full`` adds raster and chosen views, which take longest."""
    rng = np.random.default_rng((seed, 0))
    cell = make_cell(load_robot("ur5"), rng)
    joints = random_views(cell, 45, rng)
    problem = observe(cell, joints, rng)
    answer = calibrate(problem, rng, QUICK)
    known_problem = with_true_lenses(cell, problem)
    known = calibrate(known_problem, rng, replace(QUICK, solve_lenses=False))
    white = cell.levels.pose
    truth = truth_state(cell, problem)
    everything = Freedom(lens=True, robot=True, white=white)
    bound = bound_errors(cell, problem, truth, everything)
    bound_known = bound_errors(cell, known_problem, truth, replace(everything, lens=False))
    inside, inside_points = ellipsoids(cell, answer)
    peers, ours, bound_alone = against_opencv(cell, seed)
    start = time.process_time()
    solve(Model(answer.problem, answer.freedom))
    run = Run(
        errors(cell, answer),
        errors(cell, known),
        bound.tolist(),
        bound_known.tolist(),
        inside,
        inside_points,
        peers,
        ours,
        bound_alone,
        {name: e.tolist() for name, e in opencv_errors(cell, known_problem).items()},
        time.process_time() - start,
    )
    if full:
        run.user = errors(cell, calibrate(problem.only_views(range(30)), rng, QUICK))
        raster = observe(cell, raster_views(cell, 30), rng)
        run.raster = errors(cell, calibrate(raster, rng, QUICK))
        run.chosen = chosen_views(cell, seed, COUNTS)
    return run


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """All figures over ``runs`` seeds; finished ones are kept."""
    cache = RunCache("calibration-peers", seed)
    done: list[Run] = []
    for k in range(runs):
        progress(f"seed {seed + k}", k / runs)

        def compute(k: int = k) -> dict[str, Any]:
            # Chosen views take most of the time: the first ten seeds have them.
            return asdict(one(seed + k, full=k < FULL))

        done.append(Run(**cache.get(k, compute)))
    progress("tables", 1.0)
    return outcome(done)


EXPERIMENT = Experiment(
    "calibration-peers",
    "Calibration against the bound and against OpenCV, same corners",
    run,
    runs=20,
    about=(
        "Three cameras about a UR5 (T1's cell), corners with the noise and outliers of real "
        "detectors, an arm with absolute errors, a board with print errors. Lenses start from the "
        "maker's sheet."
    ),
)
