"""OpenCV's hand-eye solvers on the corners of the synthetic cell."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from armsight.arrays import Floats, Poses
from armsight.calibration.calibrate import (
    calibrate,
)
from armsight.calibration.peers import solvers
from armsight.calibration.problem import Freedom, Problem
from armsight.calibration.start import planar_poses
from armsight.calibration.synthetic import (
    SyntheticCell,
    observe,
    random_views,
    target_error,
)
from armsight.experiments.calibration_peers_cell import (
    LENSES,
    QUICK,
    bound_errors,
    truth_state,
    with_true_lenses,
)
from armsight.geometry.pose import inverse


def opencv_poses(A: Poses, C: Poses) -> dict[str, Floats]:
    """``T_base_camera`` by each of OpenCV's solvers that ends."""
    out: dict[str, Floats] = {}
    for name, solver in solvers().items():
        try:
            out[name.removeprefix("OpenCV ")] = solver(A, C)[0]
        except cv2.error:
            continue
    return out


def opencv_errors(cell: SyntheticCell, problem: Problem) -> dict[str, Floats]:
    """Target error of each OpenCV solver, (cameras,): each camera by its colour corners alone."""
    errors: dict[str, list[float]] = {}
    state = truth_state(cell, problem)
    for lens in LENSES["colour"]:
        rig = problem.lenses[lens].rig
        camera = problem.lenses[lens].camera
        A, C = [], []
        for s in problem.sightings:
            if s.lens != lens:
                continue
            found = planar_poses(camera, problem.boards[0].points[s.corner], s.pixel)
            if found is not None and found.rms_px[0] < 2.0:
                A.append(problem.views[s.view].T_base_flange)
                C.append(found.T_lens_board[0])
        if len(A) < 3:
            continue
        for name, T in opencv_poses(np.array(A), np.array(C)).items():
            poses = cell.state.T_mount_rig.copy()
            poses[rig] = T @ inverse(cell.state.T_rig_lens[lens])
            error = target_error(cell, replace(state, T_mount_rig=poses), lens)
            errors.setdefault(name, []).append(error)
    return {name: np.array(e) for name, e in errors.items()}


def against_opencv(
    cell: SyntheticCell, seed: int, count: int = 15
) -> tuple[dict[str, float], float, float]:
    """One camera, true lens known, same corners: target error of OpenCV's solvers, ours, bound."""
    rng = np.random.default_rng((seed, 1))
    alone = replace(cell, levels=replace(cell.levels, wrong_boards=0.0))
    joints = random_views(alone, count, rng, cameras=(0,))
    problem = with_true_lenses(alone, observe(alone, joints, rng)).only_lenses([1])
    ours = calibrate(problem, rng, replace(QUICK, solve_lenses=False))
    theirs = {name: float(e[0]) for name, e in opencv_errors(alone, problem).items()}
    everything = Freedom(lens=False, robot=True, white=alone.levels.pose)
    bound = bound_errors(alone, problem, truth_state(alone, problem), everything)
    return theirs, target_error(alone, ours.solution.state, 1), float(bound[1])
