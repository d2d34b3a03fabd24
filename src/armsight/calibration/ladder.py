"""How much to believe: climb from a rigid model to a rich one while unseen views gain from it.

The lowest rung is an exact arm and an exact board. Freedoms are added one by one, the most helpful
first: an independent error at every pose, of a size that the data tell; the arm's kinematic errors;
the board's print; the lens. A rung is taken when it predicts views that it has not seen better than
the last one taken (design page, 5.2). Every rung that was tried is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.covariance import invert
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom, Priors, Problem, lens_from_vector
from armsight.calibration.solver import Solution, SolverOptions, solve


@dataclass(frozen=True)
class LeftOut:
    """How well views are predicted by a solve that has not seen them.

    Attributes:
        px: rms distance in the image [px].
        mm: mean distance of the seen pixel's ray, on the predicted board's plane, from the corner.
        px_all, mm_all: the same two for the solve that has seen every view.
    """

    px: float
    mm: float
    px_all: float
    mm_all: float


@dataclass(frozen=True)
class Rung:
    """One model that was tried.

    Attributes:
        name: in words; freedom: what it moves.
        solution: on all views; left_out: its test; taken: whether it was better.
    """

    name: str
    freedom: Freedom
    solution: Solution
    left_out: LeftOut
    taken: bool


@dataclass(frozen=True)
class Ladder:
    """All rungs and the chosen one."""

    rungs: tuple[Rung, ...]

    @property
    def best(self) -> Rung:
        """The last rung taken."""
        return [r for r in self.rungs if r.taken][-1]


def pose_noise(
    solution: Solution, floor: tuple[float, float] = (2e-5, 3e-5)
) -> tuple[float, float]:
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
    H_inv = np.linalg.inv(normal.H_view)
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
    own = _scatter_within(solution)
    count = np.maximum(model.seen.sum(1) - 3, 0)  # a pose takes three corners
    out = np.empty(model.count)
    for lens in np.unique(model.lens_of):
        mine = np.flatnonzero(model.lens_of == lens)
        usual = float(np.sqrt(np.median(raw[mine][model.seen[mine]]) / (2 * np.log(2.0))))
        ratio = own[mine] / max(float(np.median(own[mine])), 1e-12)
        share = (trust + count[mine] * ratio) / (trust + count[mine])
        out[mine] = left * usual * np.sqrt(share)
    return np.maximum(out, floor)


def _scatter_within(solution: Solution) -> Floats:
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
) -> tuple[Solution, Freedom]:
    """Solve while the sizes of corner noise and of white pose errors are estimated.

    Returns:
        The solution (its model's problem carries the corner noise) and the freedom with the
        size of the pose errors.
    """
    solution = solve(Model(problem, freedom, priors), None, options)
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


def left_out_errors(
    problem: Problem,
    freedom: Freedom,
    whole: Solution,
    folds: int = 5,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
) -> LeftOut:
    """Predict each view by a solve without it (in folds when there are many).

    Args:
        problem: with start values.
        freedom: of the model under test.
        whole: its solution on all views: the start of every solve.
        folds: solves to make; one a view when there are no more views than this.
        priors: of the solves.
        options: of the solves.
    """
    views = [v for v in problem.used_views if not problem.views[v].free]
    groups = [views[k::folds] for k in range(min(folds, len(views)))]
    px, mm = [], []
    for group in groups:
        rest = [v for v in problem.used_views if v not in group]
        model = Model(problem.only_views(rest), freedom, priors)
        solution = solve(model, whole.state, with_cut(options))
        a, b = prediction_errors(problem.only_views(group), solution)
        px.append(a)
        mm.append(b)
    a_all, b_all = prediction_errors(problem.only_views(views), whole)
    if not px:
        return LeftOut(float("nan"), float("nan"), _rms(a_all), _mean(b_all))
    return LeftOut(_rms(np.concatenate(px)), _mean(np.concatenate(mm)), _rms(a_all), _mean(b_all))


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
        mm.append(1e3 * _on_plane(rays, corners[f][seen]))
    return px, np.concatenate(mm) if mm else np.zeros(0)


def _on_plane(rays: Floats, corners: Floats) -> Floats:
    """Distance between corners and where their rays meet the corners' plane [m]."""
    middle = corners.mean(0)
    normal = np.linalg.svd(corners - middle)[2][2]
    t = (middle @ normal) / (rays @ normal)
    return np.asarray(np.linalg.norm(rays * t[:, None] - corners, axis=1))


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else float("nan")


def _mean(x: Floats) -> float:
    return float(np.mean(x)) if len(x) else float("nan")


WHITE = (1e-4, 2e-4)  # where the search for the size of pose errors starts


def climb(
    problem: Problem,
    *,
    lens: bool,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
    folds: int = 5,
    gain: float = 0.02,
    progress: Callable[[str], None] | None = None,
) -> Ladder:
    """Add freedoms one by one, the most helpful first, while unseen views gain from them.

    Args:
        problem: with start values.
        lens: lenses are to be solved in every rung (they have never been calibrated); otherwise
            freeing them is one of the freedoms.
        priors: of the solves.
        options: of the solves.
        folds: for the left-out test.
        gain: a rung must lower the left-out error by this share.
        progress: called with each rung's name.
    """
    plain = Freedom(lens=lens, shape=False, white=None)
    extras = {"board's print": {"shape": True}, "pose errors": {"white": WHITE}}
    if problem.robot is not None:
        extras["arm's kinematics"] = {"robot": True}
    if not lens and any(not item.keep for item in problem.lenses):
        extras["lenses"] = {"lens": True}

    def test(names: tuple[str, ...]) -> Rung:
        title = "exact arm" if not names else "+ " + ", ".join(names)
        if progress is not None:
            progress(title)
        freedom = plain
        for name in names:
            freedom = replace(freedom, **extras[name])  # type: ignore[arg-type]
        solution, freedom = solve_with_noise(problem, freedom, priors, options)
        left_out = left_out_errors(
            solution.model.problem, freedom, solution, folds, priors, options
        )
        return Rung(title, freedom, solution, left_out, False)

    chosen: tuple[str, ...] = ()
    best = replace(test(chosen), taken=True)
    rungs = [best]
    while len(chosen) < len(extras):
        trials = [(name, test((*chosen, name))) for name in extras if name not in chosen]
        name, top = min(trials, key=lambda item: item[1].left_out.mm)
        # With the arm's kinematics free its other errors are white: test them together as well.
        if top.left_out.mm < (1 - gain) * best.left_out.mm:
            chosen, best = (*chosen, name), replace(top, taken=True)
            rungs += [best if rung is top else rung for _, rung in trials]
        else:
            rungs += [rung for _, rung in trials]
            break
    if "pose errors" not in chosen:
        # An error model that predicts as well as a rigid arm is the more honest one.
        last = next((r for r in reversed(rungs) if r.name.endswith("pose errors")), None)
        names = (*chosen, "pose errors")
        title = "+ " + ", ".join(names)
        if last is None or last.name != title:
            last = test(names)
            rungs.append(last)
        if last.left_out.mm < (1 + gain) * best.left_out.mm:
            rungs = [replace(r, taken=True) if r is last else r for r in rungs]
            rungs.sort(key=lambda r: r.taken and r.name == title)
    return Ladder(tuple(rungs))


def ladder_lines(ladder: Ladder) -> Sequence[str]:
    """The rungs for people, one a line."""
    return [
        f"{'*' if r is ladder.best else '+' if r.taken else ' '} {r.name:60s} "
        f"seen {r.left_out.px_all:6.3f} px {r.left_out.mm_all:6.3f} mm   "
        f"left out {r.left_out.px:6.3f} px {r.left_out.mm:6.3f} mm"
        for r in ladder.rungs
    ]
