"""How well views are predicted by a solve that has not seen them, nor any like them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.model import Model
from armsight.calibration.noise import with_cut
from armsight.calibration.problem import Freedom, Priors, Problem, lens_from_vector
from armsight.calibration.solver import Solution, SolverOptions, solve


@dataclass(frozen=True)
class LeftOut:
    """How well views are predicted by a solve that has not seen them.

    Attributes:
        px: rms distance in the image [px].
        mm: mean distance of the seen pixel's ray, on the predicted board's plane, from the corner.
        px_all, mm_all: the same two for the solve that has seen every view.
        groups: mean distance of each group that was left out [mm].
    """

    px: float
    mm: float
    px_all: float
    mm_all: float
    groups: tuple[float, ...] = ()


def left_out_errors(
    problem: Problem,
    freedom: Freedom,
    whole: Solution,
    folds: int = 5,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
) -> LeftOut:
    """Predict groups of similar views by solves without them.

    Views that are near each other share the arm's errors: one that was left out alone is told by
    its neighbours, and every freedom seems to help.

    Args:
        problem: with start values.
        freedom: of the model under test.
        whole: its solution on all views: the start of every solve.
        folds: groups; one a view when there are no more views than this.
        priors: of the solves.
        options: of the solves.
    """
    views = [v for v in problem.used_views if not problem.views[v].free]
    groups = pose_groups(problem, views, folds)
    near = with_cut(options)
    near = replace(near, tolerance=max(near.tolerance, 1e-6))  # far below what views differ by
    px, mm = [], []
    for group in groups:
        rest = [v for v in problem.used_views if v not in group]
        model = Model(problem.only_views(rest), freedom, priors)
        solution = solve(model, whole.state, near)
        a, b = prediction_errors(problem.only_views(group), solution)
        px.append(a)
        mm.append(b)
    a_all, b_all = prediction_errors(problem.only_views(views), whole)
    if not px:
        return LeftOut(float("nan"), float("nan"), _rms(a_all), _mean(b_all), ())
    return LeftOut(
        _rms(np.concatenate(px)),
        _mean(np.concatenate(mm)),
        _rms(a_all),
        _mean(b_all),
        tuple(_mean(m) for m in mm),
    )


REACH = 0.3
"""A turn of a radian counts as so many metres where poses are compared [m]."""


def pose_groups(problem: Problem, views: Sequence[int], count: int) -> list[list[int]]:
    """Views in groups of similar arm poses, about alike in size.

    Seeds are as far apart as can be; each view in turn goes to the nearest group with room.
    """
    if len(views) <= count:
        return [[v] for v in views]
    T = np.array([problem.views[v].T_base_flange for v in views])
    x = np.concatenate([T[:, :3, 3], REACH * T[:, :3, 0], REACH * T[:, :3, 1]], axis=1)
    gap = np.linalg.norm(x[:, None] - x[None], axis=-1)
    seeds = [int(np.argmax(gap.sum(0)))]
    while len(seeds) < count:
        seeds.append(int(np.argmax(gap[seeds].min(0))))
    room = -(-len(views) // count)
    groups: list[list[int]] = [[] for _ in seeds]
    for k in np.argsort(gap[seeds].min(0), kind="stable"):
        for g in np.argsort(gap[seeds, k], kind="stable"):
            if len(groups[g]) < room:
                groups[g].append(views[int(k)])
                break
    return [sorted(g) for g in groups if g]


def prediction_errors(problem: Problem, solution: Solution) -> tuple[Floats, Floats]:
    """Corners of some views against a solution, each arm pose taken as the arm says it.

    Returns:
        (n,) distances in the image [px]; (n,) distances on the predicted board's plane [mm].
    """
    model = Model(problem, replace(solution.model.freedom, white=None), solution.model.priors)
    state = model.with_exact_views(solution.state)
    lin = model.linearise(state, False)
    d = (lin.residual * model.sigma[:, None, None])[model.seen]
    px = np.linalg.norm(d, axis=1)
    corners = model.lens_points(state)
    mm: list[Floats] = []
    for f in range(model.count):
        seen = model.seen[f]
        lens = problem.lenses[model.lens_of[f]].camera
        camera = lens_from_vector(state.lens[model.lens_of[f]], lens.width, lens.height)
        rays = np.column_stack([camera.normalise(model.pixel[f][seen]), np.ones(seen.sum())])
        mm.append(1e3 * on_plane(rays, corners[f][seen]))
    return px, np.concatenate(mm) if mm else np.zeros(0)


def on_plane(rays: Floats, corners: Floats) -> Floats:
    """Distance between corners and where their rays meet the corners' plane [m]."""
    middle = corners.mean(0)
    normal = np.linalg.svd(corners - middle)[2][2]
    t = (middle @ normal) / (rays @ normal)
    return np.asarray(np.linalg.norm(rays * t[:, None] - corners, axis=1))


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else float("nan")


def _mean(x: Floats) -> float:
    return float(np.mean(x)) if len(x) else float("nan")
