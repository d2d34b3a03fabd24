"""Mistakes that show only in the residuals of a good solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.calibration.findings import Finding
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom, lens_from_vector, lens_vector
from armsight.calibration.solver import Solution, SolverOptions, solve
from armsight.geometry.camera import PinholeCamera

SLIP_RATIO = 12.0
"""F ratio above which a board counts as slipped: clean sets stay below 3, 2 mm give 30."""


def diagnose_solution(solution: Solution, rig: int) -> list[Finding]:
    """Mistakes that show only in the residuals of a good solve."""
    lens = distortion_findings(solution, rig)
    # A lens that is wrong leaves residuals that a second board would explain in part.
    return [*lens, *([] if lens else slip_findings(solution, rig)), *moving_findings(solution, rig)]


def distortion_findings(solution: Solution, rig: int) -> list[Finding]:
    """A kept distortion that the data contradict."""
    model = solution.model
    problem = model.problem
    out: list[Finding] = []
    if model.freedom.lens and not any(lens.keep for lens in problem.lenses):
        return out
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
        r = np.linspace(0, np.hypot(lens.camera.width, lens.camera.height) / 2 / before[0], 20)
        change = (after - before)[[4, 5, 8]] @ np.array([r**3, r**5, r**7])
        change -= r * (change @ r) / (r @ r)  # a change of focal length is no distortion
        bend = float(np.abs(change).max() * before[0])
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


def slip_findings(solution: Solution, rig: int) -> list[Finding]:
    """A board that slipped, or a camera that was bumped, at some view.

    A likelihood ratio: two boards against one, over every place in the order of views.
    """
    model = solution.model
    problem = model.problem
    mine = problem.only_lenses([i for i, lens in enumerate(problem.lenses) if lens.rig == rig])
    views = [v for v in mine.used_views if not problem.views[v].free]
    if len(views) < 8:
        return []
    freedom = Freedom(lens=False, shape=False, robot=mine.robot is not None, white=(1e-4, 2e-4))
    fast = SolverOptions(iterations=8, tolerance=1e-4)
    fixed = tuple(replace(lens, camera=_solved(solution, i)) for i, lens in enumerate(mine.lenses))
    mine = replace(mine, lenses=fixed)
    exact = replace(solution.state, E=np.tile(np.eye(4), (len(problem.views), 1, 1)))
    first = solve(Model(mine, freedom), exact, fast)
    n = len(mine.boards)
    doubled = replace(
        first.state,
        T_mount_board=np.concatenate([first.state.T_mount_board] * 2),
        shape=np.concatenate([first.state.shape] * 2),
    )
    best: tuple[float, int] | None = None
    for k in range(3, len(views) - 2):
        late = set(views[k:])
        split = replace(
            mine,
            boards=(*mine.boards, *mine.boards),
            sightings=tuple(
                replace(s, board=s.board + n) if s.view in late else s for s in mine.sightings
            ),
        )
        cost = solve(Model(split, freedom), doubled, fast).normal.cost
        if best is None or cost < best[0]:
            best = (cost, k)
    assert best is not None
    freedom_left = max(2 * int(first.model.seen.sum()) - 12 - 6 * len(views), 12)
    noise = max(2 * best[0] / freedom_left, 1.0)
    ratio = 2 * (first.normal.cost - best[0]) / 6 / noise
    if ratio < SLIP_RATIO:
        return []
    return [
        Finding(
            "slip",
            "error",
            f"board or camera {problem.rigs[rig].name} moved between view {views[best[1] - 1]} and "
            f"view {views[best[1]]}: apart, the two parts fit (F {ratio:.0f})",
            "tighten the board and the camera's stand, and repeat",
        )
    ]


def _solved(solution: Solution, lens: int) -> PinholeCamera:
    camera = solution.model.problem.lenses[lens].camera
    return lens_from_vector(solution.state.lens[lens], camera.width, camera.height)


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
