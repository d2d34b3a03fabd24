"""Sizes of the noise, told by the data: of corners in each sighting, of the arm's poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.covariance import invert
from armsight.calibration.model import Model, State
from armsight.calibration.problem import Freedom, Priors, Problem
from armsight.calibration.solver import Solution, SolverOptions, solve

WHITE = (1e-4, 2e-4)
"""Where the search for the size of pose errors starts [m], [rad]."""


FLOOR = (2e-5, 3e-5)
"""No arm repeats better [m], [rad]; one that is told to has no error at all: it is simulated."""


def pose_noise(solution: Solution, floor: tuple[float, float] = FLOOR) -> tuple[float, float]:
    """The size of the arm's independent pose error that the data tell (translation, rotation).

    Evidence (MacKay) update of the prior's variance: the sum of squares of the estimated errors
    over the number of them that the data determine.

    Args:
        solution: of a model with white pose errors.
        floor: no smaller than this [m], [rad].
    """
    model, normal = solution.model, solution.normal
    white = np.trace(model.view_information[normal.views], axis1=1, axis2=2) > 0
    if not white.any():
        return floor
    views = normal.views[white]
    e = se3.logs(solution.state.E[views])
    W = model.view_information[views[0]]
    H_inv = np.linalg.pinv(normal.H_view, hermitian=True)  # a diverged view has none
    spread = H_inv @ np.swapaxes(normal.H_mixed, 1, 2)  # (v, 6, g)
    S_inv = invert(normal.reduced())
    cov = (H_inv + spread @ S_inv @ np.swapaxes(spread, 1, 2))[white]
    variance = np.diagonal(cov, axis1=1, axis2=2)
    out = []
    for at, low in ((slice(0, 3), floor[0]), (slice(3, 6), floor[1])):
        weight = W[at, at][0, 0]
        determined = 3 * len(views) - weight * float(variance[:, at].sum())
        total = float(np.sum(e[:, at] ** 2))
        out.append(float(np.sqrt(max(total / max(determined, 1.0), low**2))))
    return out[0], out[1]


def corner_noise(solution: Solution, trust: float = 12.0, floor: float = 0.02) -> Floats:
    """(F,) standard deviation of a corner's coordinate in each sighting [px], outliers apart.

    Each lens has a noise, corrected for the unknowns that were fitted. A small, slanted or glaring
    board scatters more than others through the same lens: what is left within its image when the
    board may go where it likes tells by how much, drawn towards the usual for few corners. Medians
    are used, so that a few corners on other things do not matter.

    Args:
        solution: of a model with any noise.
        trust: corners that the usual counts for beside the sighting's own.
        floor: no smaller than this [px].
    """
    model = solution.model
    spent = len(solution.normal.free) + 6 * len(solution.normal.views)
    total = 2 * int(model.seen.sum())
    left = np.sqrt(total / max(total - spent, 0.25 * total, 1.0))
    raw = np.sum((solution.residual * model.sigma[:, None, None]) ** 2, axis=-1)
    own = scatter_within(solution)
    count = np.maximum(model.seen.sum(1) - 3, 0)  # a pose takes three corners
    out = np.empty(model.count)
    for lens in np.unique(model.lens_of):
        mine = np.flatnonzero(model.lens_of == lens)
        usual = float(np.sqrt(np.median(raw[mine][model.seen[mine]]) / (2 * np.log(2.0))))
        ratio = own[mine] / max(float(np.median(own[mine])), 1e-12)
        share = (trust + count[mine] * ratio) / (trust + count[mine])
        out[mine] = left * usual * np.sqrt(share)
    return np.maximum(out, floor)


def scatter_within(solution: Solution) -> Floats:
    """(F,) median squared residual of each sighting with its own pose free [px^2]."""
    model = solution.model
    pose = model.linearise(solution.state).jacobian[..., -6:]
    F, K = model.seen.shape
    out = np.empty(F)
    for f in range(F):
        weight = np.repeat(np.sqrt(solution.normal.weight[f]), 2)[:, None]
        A = pose[f].reshape(2 * K, 6)
        r = solution.residual[f].reshape(2 * K)
        x = np.linalg.lstsq(A * weight, r * weight[:, 0], rcond=1e-9)[0]
        square = np.sum((r - A @ x).reshape(K, 2) ** 2, axis=1)[model.seen[f]]
        out[f] = float(np.median(square)) * model.sigma[f] ** 2
    return out


EXACT = 1.02
"""Corners may scatter by so much more when the arm is taken to be exact [1]."""


def exact_arm(
    solution: Solution,
    freedom: Freedom,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
) -> tuple[Solution, Freedom]:
    """The same without errors of the arm, where the data tell of none.

    Poses that come from a simulation are exact: errors of the size that the best arm has cost
    accuracy over metres. Corners must fit as well without them.
    """
    white = freedom.white
    if white is None or white[0] > 1.01 * FLOOR[0] or white[1] > 1.01 * FLOOR[1]:
        return solution, freedom
    rigid = replace(freedom, white=None)
    problem = solution.model.problem
    model = Model(problem, rigid, priors)
    exact = solve(model, model.with_exact_views(solution.state), with_cut(options))
    noise = corner_noise(exact)
    if float(np.median(noise / solution.model.sigma)) > EXACT:
        return solution, freedom
    problem = with_corner_noise(problem, noise)
    return solve(Model(problem, rigid, priors), exact.state, with_cut(options)), rigid


CUT = 6.0
"""Corners farther off than so many sigma lie on another thing, and do not count [1]."""


def with_corner_noise(problem: Problem, noise: Floats) -> Problem:
    """The same sightings with other standard deviations, (F,) [px]."""
    return replace(
        problem,
        sightings=tuple(replace(s, sigma=float(x)) for s, x in zip(problem.sightings, noise)),
    )


def solve_with_noise(
    problem: Problem,
    freedom: Freedom,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
    rounds: int = 4,
    state: State | None = None,
) -> tuple[Solution, Freedom]:
    """Solve while the sizes of corner noise and of white pose errors are estimated.

    Args:
        problem: with start values.
        freedom: of the model.
        priors: of the solves.
        options: of the solves.
        rounds: at most.
        state: where to start instead.

    Returns:
        The solution (its model's problem carries the corner noise) and the freedom with the
        size of the pose errors.
    """
    solution = solve(Model(problem, freedom, priors), state, options)
    options = with_cut(options)
    for turn in range(rounds):
        noise = corner_noise(solution)
        change = np.abs(np.log(noise / solution.model.sigma))
        settled = turn > 0 and float(np.median(change)) < 0.05
        white = freedom.white
        if white is not None:
            t, r = pose_noise(solution)
            settled = settled and abs(t / white[0] - 1) < 0.05 and abs(r / white[1] - 1) < 0.05
            freedom = replace(freedom, white=(t, r))
        if settled:
            break
        problem = with_corner_noise(problem, noise)
        solution = solve(Model(problem, freedom, priors), solution.state, options)
    return solution, freedom


def with_cut(options: SolverOptions | None) -> SolverOptions:
    """Options for a solve that starts near its answer."""
    return replace(options or SolverOptions(), cut=CUT)
