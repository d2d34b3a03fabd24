"""Mistakes that show only in the residuals of a good solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.calibrate import Calibration
from armsight.calibration.diagnosis.noise import noise_findings
from armsight.calibration.diagnosis.slip import slip_findings
from armsight.calibration.findings import Finding
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom, lens_vector
from armsight.calibration.solver import Solution, SolverOptions, solve


def diagnose_solution(
    answer: Calibration,
    rig: int,
    names: Sequence[str],
    seed: int = 0,
    given: Sequence[bool] = (),
) -> list[Finding]:
    """Mistakes that show only in the residuals of a good solve.

    Args:
        answer: the solve.
        rig: the camera.
        names: of the views, for messages.
        seed: of random draws.
        given: of each lens, whether somebody gave it.
    """
    solution = answer.solution
    bent = distortion_findings(solution, rig, given)
    return [
        *bent,
        # A lens that is wrong leaves residuals that a second board would explain in part.
        *([] if bent else slip_findings(answer, rig, names, seed)),
        *moving_findings(solution, rig),
        *noise_findings(answer, rig, names),
    ]


def _left_its_prior(solution: Solution, rig: int, given: Sequence[bool]) -> list[Finding]:
    """A given lens that was solved, too, and came out bent otherwise than it was given."""
    out = []
    for index, lens in enumerate(solution.model.problem.lenses):
        if lens.rig != rig or lens.prior is None or not (index < len(given) and given[index]):
            continue
        before, after = lens_vector(lens.camera), solution.state.lens[index]
        bend = _bend(before, after, lens.camera.width, lens.camera.height)
        if bend > 3.0:
            out.append(
                Finding(
                    "distortion",
                    "warning",
                    f"lens {lens.name}: the distortion that was given is missing, wrong or applied "
                    f"twice: the pictures want up to {bend:.1f} px otherwise; solved anew",
                    "calibrate the lens, or give pictures as they came from the camera",
                )
            )
    return out


def _bend(before: Floats, after: Floats, width: int, height: int) -> float:
    """Largest difference of two lenses' distortions over the image [px]."""
    r = np.linspace(0, np.hypot(width, height) / 2 / before[0], 20)
    change = (after - before)[[4, 5, 8]] @ np.array([r**3, r**5, r**7])
    change -= r * (change @ r) / (r @ r)  # a change of focal length is no distortion
    return float(np.abs(change).max() * before[0])


def distortion_findings(solution: Solution, rig: int, given: Sequence[bool] = ()) -> list[Finding]:
    """A kept distortion that the data contradict."""
    model = solution.model
    problem = model.problem
    out: list[Finding] = []
    if model.freedom.lens and not any(lens.keep for lens in problem.lenses):
        return _left_its_prior(solution, rig, given)
    for index, lens in enumerate(problem.lenses):
        if lens.rig != rig or index not in model.lens_of:
            continue
        lenses = tuple(
            replace(item, keep=k != index, prior=None if k == index else item.prior)
            for k, item in enumerate(problem.lenses)
        )
        # An arm that repeats: large pose errors would hide in part what the lens does.
        arm = Freedom(lens=False, shape=False, white=(1e-4, 2e-4))
        fast = SolverOptions(iterations=30, tolerance=1e-6)
        state = model.with_exact_views(solution.state)
        held = solve(Model(problem, arm), state, fast)
        trial = Model(replace(problem, lenses=lenses), replace(arm, lens=True))
        freed = solve(trial, state, fast)
        before, after = lens_vector(lens.camera), freed.state.lens[index]
        bend = _bend(before, after, lens.camera.width, lens.camera.height)
        kept, free = _median_px(held, index), _median_px(freed, index)
        if bend > 1.0 and kept > 1.4 * free:
            out.append(
                Finding(
                    "distortion",
                    "warning",
                    f"lens {lens.name}: its distortion is missing, wrong or applied twice (up to "
                    f"{bend:.1f} px); freed, the error falls from {kept:.2f} to {free:.2f} px",
                    "calibrate the lens, or give images as they came from the camera",
                )
            )
    return out


def _median_px(solution: Solution, lens: int) -> float:
    raw = np.linalg.norm(solution.residual, axis=-1) * solution.model.sigma[:, None]
    return float(np.median(raw[(solution.model.lens_of == lens)[:, None] & solution.model.seen]))


def moving_findings(solution: Solution, rig: int) -> list[Finding]:
    """Residuals that grow with the arm's speed at exposure."""
    model = solution.model
    speed = np.array([np.linalg.norm(v.twist[:3]) for v in model.problem.views])
    if speed.max(initial=0.0) < 2e-3:
        return []
    mine = np.flatnonzero(model.rig_of == rig)
    raw = np.linalg.norm(solution.residual, axis=-1) * model.sigma[:, None]
    error = np.array([np.median(raw[f][model.seen[f]]) for f in mine])
    v = speed[model.view_of[mine]]
    if len(mine) < 6 or np.std(v) < 1e-6:
        return []
    correlation = float(np.corrcoef(v, error)[0, 1])
    if correlation < 0.6:
        return []
    return [
        Finding(
            "moving",
            "warning",
            f"camera {model.problem.rigs[rig].name}: errors grow with the arm's speed at exposure "
            f"(correlation {correlation:.2f})",
            "let the arm rest for 0.3 s before each image",
        )
    ]
