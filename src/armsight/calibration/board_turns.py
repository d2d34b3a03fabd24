"""Boards that look alike from two sides: the arm tells how each was read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.calibration import se3
from armsight.calibration.boards import Turn
from armsight.calibration.problem import Problem
from armsight.calibration.start import arm_for


def settle_turns(problem: Problem, turns: tuple[Turn, ...], better: float = 1.0) -> Problem:
    """Every sighting read in the way that fits the start values of camera and board best.

    Args:
        problem: with start values.
        turns: ways to read the board.
        better: a turned reading must fit this many times better than the one that was given.
    """
    if not turns:
        return problem
    T = {rig: arm_for(problem, rig) for rig in range(len(problem.rigs))}
    out = []
    for s in problem.sightings:
        lens = problem.lenses[s.lens]
        rig, board = problem.rigs[lens.rig], problem.boards[s.board]
        if problem.views[s.view].free:
            out.append(s)
            continue
        C = se3.inverses((rig.T_mount_rig @ lens.T_rig_lens)[None])[0]
        C = C @ T[lens.rig][s.view] @ board.T_mount_board
        best = s
        least = np.inf
        for corner in (s.corner, *(t.corner[s.corner] for t in turns)):
            p = board.points[corner] @ C[:3, :3].T + C[:3, 3]
            d = lens.camera.project(p) - s.pixel
            miss = float(np.median(np.linalg.norm(d, axis=1)))
            if np.isfinite(miss) and miss * (1.0 if corner is s.corner else better) < least:
                order = np.argsort(corner)
                best = replace(s, corner=corner[order], pixel=s.pixel[order])
                least = miss
        out.append(best)
    return replace(problem, sightings=tuple(out))
