"""Boards that were seen wrongly as a whole: found among few as among many, left out with a reason.

A detector that slips by a square, reads a board upside down or takes another thing for it is
consistent within its image, and so is a wrong arm pose. Only the rest of the data shows it: the
arm, the other boards, the other lenses. Each sighting is therefore judged against what all others
predict *without* it, in the joint problem: how far would the flange have to be displaced, for this
lens in this view alone, to explain it (six numbers), and how sure is that prediction? This is the
score test of a mean-shift outlier (Cook and Weisberg, Residuals and Influence in Regression, 1982,
2.2.2). Where a lens has few boards the prediction is loose, and the test knows it: nothing is left
out that the others cannot judge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Ints, Mask
from armsight.calibration.covariance import invert
from armsight.calibration.model import Linearised, Model, State
from armsight.calibration.noise import WHITE, with_corner_noise
from armsight.calibration.problem import Freedom, Priors, Problem, Sighting
from armsight.calibration.solver import Solution, SolverOptions, solve

USUAL = 5.348
"""Median of chi squared with six degrees of freedom."""
UNKNOWN = 0.3
"""Sigma of a prediction that judges nothing any more [m], [rad]."""
WORST = 150.0
"""No arm errs by so many times ``WHITE``, backlash and a short robust solve included [1]."""


@dataclass(frozen=True)
class OutlierRule:
    """When a board counts as an outlier.

    Attributes:
        limit: chi squared (six degrees of freedom) of a sighting against the rest [1].
        corners: its middle corner must be off by so many times its lens's noise as well [1]: what
            is less harms little, and may be the lens model.
        many: boards of a lens among which one wrong one does not bend the answer much.
        rivals: views that are left out in turn where boards are fewer.
        doubt: none goes when the absence of another would help as much, up to this difference of
            half the sum of squares: that one is wrong is sure then, but not which.
        most: at most this share of the views.
        rounds: at most.
    """

    limit: float = 60.0
    corners: float = 6.0
    many: int = 9
    rivals: int = 8
    doubt: float = 10.0
    most: float = 0.5
    rounds: int = 8


@dataclass(frozen=True)
class Judged:
    """Every sighting against what the rest of the data predict.

    Attributes:
        shift: (F, 6) displacement of the flange that would explain each (translation [m],
            rotation [rad], in the flange's axes); zero where nothing can judge it.
        covariance: (F, 6, 6) of that, without the arm's own scatter.
        px: (F,) median distance of its corners from the prediction [px].
    """

    shift: Floats
    covariance: Floats
    px: Floats

    def chi2(self, scatter: float = 1.0) -> Floats:
        """(F,) chi squared of the shifts with an arm that errs by so many times ``WHITE``."""
        W = scatter**2 * np.diag([WHITE[0] ** 2] * 3 + [WHITE[1] ** 2] * 3)
        x = np.linalg.solve(self.covariance + W, self.shift[..., None])[..., 0]
        return np.asarray(np.einsum("fi,fi->f", self.shift, x))

    def arm_scatter(self) -> float:
        """How many times ``WHITE`` the arm errs, at least once: what makes most boards usual [1].

        An arm whose errors are not modelled is off by more than its repeatability; boards are
        judged by what is usual with this arm.
        """
        on = self.shift.any(axis=1)
        if not on.any():
            return 1.0
        low, high = 0.0, np.log(1e3)
        if np.median(self.chi2(1.0)[on]) <= USUAL:
            return 1.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            if np.median(self.chi2(float(np.exp(middle)))[on]) > USUAL:
                low = middle
            else:
                high = middle
        return float(np.exp(high))


def reject_outliers(
    problem: Problem,
    freedom: Freedom,
    priors: Priors | None = None,
    solver: SolverOptions | None = None,
    rule: OutlierRule | None = None,
) -> tuple[Problem, list[tuple[Sighting, str]]]:
    """Leave out boards that the rest of the data contradict.

    Round by round the worst of each lens go. When nothing contradicts any more, those that went are
    asked again: a good board that a bad one made look wrong comes back.

    Args:
        problem: with start values.
        freedom: of the solve to come.
        priors: of the solves.
        solver: of the solves.
        rule: when a board counts as an outlier.

    Returns:
        What is left, and what went with the reason.
    """
    rule = rule or OutlierRule()
    jury = Jury(problem, freedom, priors, solver)
    kept: Mask = np.ones(jury.model.count, bool)
    solution = jury.tell_noise(jury.solve(kept, None))
    judged = jury.judge(solution, kept)
    for _ in range(rule.rounds):
        score, bad = _contradicted(judged, jury.model, kept, rule)
        gone = _among_many(jury.model, score, bad & kept, rule)
        if not len(gone):
            gone = _among_few(jury, solution, score, bad & kept, kept, rule)
        if not len(gone):
            break
        kept[gone] = False
        solution = jury.solve(kept, solution.state)
        judged = jury.judge(solution, kept)
    # Good boards that a bad one made look wrong, or that shared its view, come back.
    _, bad = _contradicted(judged, jury.model, kept, rule)
    if np.any(~kept & ~bad):
        kept = kept | ~bad
        judged = jury.judge(jury.solve(kept, solution.state), kept)
    rejected = [
        (s, _reason(jury.model, judged, kept, f))
        for f, s in enumerate(problem.sightings)
        if not kept[f]
    ]
    left = tuple(s for s, k in zip(problem.sightings, kept) if k)
    return replace(problem, sightings=left), rejected


def _reason(model: Model, judged: Judged, kept: Mask, f: int) -> str:
    """Why a sighting was left out, for people."""
    pixel = model.pixel[f][model.seen[f]]
    gaps = np.linalg.norm(pixel[:, None] - pixel[None], axis=-1) + 1e9 * np.eye(len(pixel))
    squares = judged.px[f] / max(float(np.median(gaps.min(1))), 1e-9)
    others = judged.px[kept & (model.lens_of == model.lens_of[f])]
    usual = float(np.median(others)) if len(others) else 0.0
    alike = model.view_of == model.view_of[f]
    if alike.sum() > 1 and not kept[alike].any():
        cause = "wrong arm pose"
    else:
        cause = "wrongly seen board" if squares > 0.3 else "glare, blur, or an arm not at rest"
    return (
        f"{judged.px[f]:.1f} px ({squares:.2g} squares) from where all other views and cameras put "
        f"it, usual are {usual:.1f} px: {cause}"
    )


def _among_many(model: Model, score: Floats, bad: Mask, rule: OutlierRule) -> Ints:
    """The worst boards of each lens that has many: one wrong one hardly bends their answer."""
    gone: list[int] = []
    for lens in np.unique(model.lens_of[bad]):
        total = int(np.sum(model.lens_of == lens))
        mine = np.flatnonzero(bad & (model.lens_of == lens))
        if total >= rule.many:
            gone += [int(f) for f in mine[np.argsort(-score[mine])][: total // 6]]
    return np.array(gone, np.int64)


def _among_few(
    jury: Jury, solution: Solution, score: Floats, bad: Mask, kept: Mask, rule: OutlierRule
) -> Ints:
    """Boards of the view without which the rest agree best, those that the rest contradict.

    Among few, a wrong board bends the answer until good ones look as wrong: views are left out in
    turn, whole, because a wrong arm pose is seen alike by all lenses.
    """
    if not bad.any():
        return np.zeros(0, np.int64)
    view_of = jury.model.view_of
    views = np.unique(view_of[kept])
    if len(views) <= max(3, rule.most * len(np.unique(view_of))):
        return np.zeros(0, np.int64)
    worst = np.array([score[kept & (view_of == v)].max() for v in views])
    rivals = [
        np.flatnonzero(kept & (view_of == v)) for v in views[np.argsort(-worst)][: rule.rivals]
    ]
    mine = jury.culprit(rivals, kept, solution.state, rule.doubt)
    if not len(mine):
        return mine
    rest = kept.copy()
    rest[mine] = False
    _, bad = _contradicted(
        jury.judge(jury.solve(rest, solution.state), rest), jury.model, rest, rule
    )
    return mine[bad[mine]]


class Jury:
    """Solves with some sightings, and judges all of them by the answer."""

    def __init__(
        self,
        problem: Problem,
        freedom: Freedom,
        priors: Priors | None,
        solver: SolverOptions | None,
    ) -> None:
        # No pose errors: free ones would bend to swallow a slipped board. The arm's kinematic
        # errors stay: they are held by their priors, and without them good boards far out look
        # an outlier.
        self._freedom, self._priors = replace(freedom, white=None), priors
        self._solver = replace(solver or SolverOptions(), iterations=40, tolerance=1e-5)
        self.model = Model(problem, self._freedom, priors)

    def solve(self, kept: Mask, state: State | None) -> Solution:
        """The answer of some sightings."""
        problem = self.model.problem
        seen = tuple(s for s, k in zip(problem.sightings, kept) if k)
        model = Model(replace(problem, sightings=seen), self._freedom, self._priors)
        return solve(model, state, self._solver)

    def tell_noise(self, solution: Solution) -> Solution:
        """Take each lens's corner noise from what is left within its images, and solve again."""
        _, own = _own_pose(self.model, solution.state)
        noise = np.empty(self.model.count)
        for lens in np.unique(self.model.lens_of):
            mine = self.model.lens_of == lens
            square = np.sum(own[mine] ** 2, axis=-1)[self.model.seen[mine]]
            usual = float(np.sqrt(np.median(square) / (2 * np.log(2.0))))
            noise[mine] = max(usual, 0.02) * np.sqrt(8 / 7)  # six of 48 went into the pose
        self.model = Model(
            with_corner_noise(self.model.problem, noise), self._freedom, self._priors
        )
        return self.solve(np.ones(self.model.count, bool), solution.state)

    def culprit(self, rivals: list[Ints], kept: Mask, state: State, doubt: float) -> Ints:
        """The one of some sets of sightings without which the rest agree best; none in doubt."""
        costs = []
        for mine in rivals:
            trial = kept.copy()
            trial[mine] = False
            # A start that the wrong one has bent may lead nowhere.
            cost = min(self.solve(trial, start).normal.cost for start in (state, None))
            costs.append(cost + float(self.model.seen[mine].sum()))
        best = min(costs)
        if np.sum(np.array(costs) < best + doubt) > 1:
            return np.zeros(0, np.int64)
        return rivals[int(np.argmin(costs))]

    def _linearised(self, solution: Solution) -> Linearised:
        return self.model.linearise(solution.state)

    def _weights(self, solution: Solution, kept: Mask) -> Floats:
        """(F, K) robust weight of each corner in the answer; 0 for sightings left out."""
        weight = np.zeros(self.model.seen.shape)
        used = solution.normal.weight
        weight[kept, : used.shape[1]] = used
        return np.where(self.model.seen, weight, 0.0)

    def judge(self, solution: Solution, kept: Mask) -> Judged:
        """Every sighting against an answer, its own part in that answer taken away.

        All in the space of the unknowns: boards may have a thousand corners.
        """
        model = self.model
        lin = self._linearised(solution)
        F, K = model.seen.shape
        weight = self._weights(solution, kept)
        inlier, _ = _own_pose(model, solution.state)
        place = np.full(model.size, -1)
        place[solution.normal.free] = np.arange(len(solution.normal.free))
        root = _root_of(solution.normal.reduced())
        shift, covariance, px = np.zeros((F, 6)), np.tile(np.eye(6), (F, 1, 1)), np.zeros(F)
        for f in range(F):
            at = place[model.columns[f]]
            J = lin.jacobian[f].reshape(2 * K, -1)
            B = J[:, -6:]
            # In coordinates in which all the data together tell unit information.
            A = J[:, :-6][:, at >= 0] @ root[at[at >= 0]]
            r = lin.residual[f].reshape(2 * K)
            w = np.repeat(weight[f], 2)
            values, vectors = np.linalg.eigh(A.T @ (w[:, None] * A))
            rest = np.maximum(1 - values, 1e-6)  # what the others tell
            if w.any():
                r = r + A @ (vectors @ ((vectors.T @ (A.T @ (w * r))) / rest))
            px[f] = np.median(np.hypot(r[0::2], r[1::2])[model.seen[f]]) * model.sigma[f]
            if np.trace(B.T @ B) < 1e-9 or model.problem.views[model.view_of[f]].free:
                continue
            n = np.repeat(np.where(model.seen[f], inlier[f], 0.0), 2)
            A = A @ vectors
            both = np.diag(rest) + A.T @ (n[:, None] * A)
            mixed = A.T @ (n[:, None] * B)
            solved = np.linalg.solve(both, np.column_stack([mixed, A.T @ (n * r)]))
            C_f = invert(B.T @ (n[:, None] * B) - mixed.T @ solved[:, :-1])
            if np.diagonal(C_f).max() > UNKNOWN**2:
                continue
            covariance[f] = C_f
            shift[f] = -C_f @ (B.T @ (n * r) - mixed.T @ solved[:, -1])
        return Judged(shift, covariance, px)


def _root_of(S: Floats) -> Floats:
    """(g, g) with ``root @ root.T`` the inverse of an information matrix (see ``invert``)."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(S), 1e-12))
    values, vectors = np.linalg.eigh(0.5 * (S + S.T) * scale[:, None] * scale)
    return np.asarray(scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-13)))


def _contradicted(
    judged: Judged, model: Model, kept: Mask, rule: OutlierRule
) -> tuple[Floats, Mask]:
    """(F,) chi squared of each sighting, and whether the rest contradict it."""
    score = judged.chi2(_usual(judged, model))
    return score, (score > rule.limit) & (judged.px > rule.corners * model.sigma)


def _usual(judged: Judged, model: Model) -> float:
    """The arm's scatter as most of all sightings tell it.

    Those that were left out count as well: by what is kept alone, an arm that errs by millimetres
    looks better with each view that goes, until half of a good set has gone.
    """
    # An arm whose errors are in the solve has nothing but its repeatability left.
    return min(judged.arm_scatter(), 3.0 if model.freedom.robot else WORST)


def _own_pose(model: Model, state: State) -> tuple[Floats, Floats]:
    """What is left within each image when its board may go where it likes.

    Returns:
        (F, K) weight of each corner (small: it lies on another thing, or all of the image is
        noisy), and (F, K, 2) what is left [px].
    """
    lin = model.linearise(state)
    F, K = model.seen.shape
    B = lin.jacobian[..., -6:].reshape(F, 2 * K, 6)
    r = lin.residual.reshape(F, 2 * K)
    scale = 1 / np.maximum(np.linalg.norm(B, axis=1), 1e-12)  # (F, 6)
    B = B * scale[:, None, :]
    w = np.ones((F, K))
    left = r
    for _ in range(8):  # least absolute distances, by reweighting
        Bw = B * np.repeat(w, 2, axis=1)[..., None]
        N = np.swapaxes(Bw, 1, 2) @ B + 1e-9 * np.eye(6)
        x = np.linalg.solve(N, np.einsum("fnp,fn->fp", Bw, r)[..., None])[..., 0]
        left = r - np.einsum("fnp,fp->fn", B, x)
        length = np.linalg.norm(left.reshape(F, K, 2), axis=-1)
        w = 1 / np.maximum(length, 0.1)
    length = np.where(model.seen, length, np.nan)
    own = np.maximum(np.nanmedian(length, axis=1) / 1.1774, 1.0)
    ratio = length / own[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(ratio > 6.0, 1e-4, np.minimum(1.0, 3.0 / ratio)) / own[:, None] ** 2
    weight = np.where(model.seen, weight, 1.0)
    return weight, left.reshape(F, K, 2) * model.sigma[:, None, None]
