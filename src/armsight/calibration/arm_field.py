"""An arm that errs alike at like poses: its errors as a Gaussian process over its poses.

Wrong zeros, link lengths and sag displace the flange by an amount that changes smoothly with the
pose. Taken as independent, twenty such errors seem to average out, and the answer to be surer than
it is; as a process they do not, and views that were not taken are foreseen from their neighbours.
No model of the arm is needed (Rasmussen and Williams, Gaussian Processes for Machine Learning,
2006, sections 2.7 and 5.4.1: a linear model with explicit unknowns, sizes by the marginal
likelihood in which those are integrated out).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from armsight.arrays import Floats, Ints, Pose, Poses
from armsight.calibration import se3
from armsight.calibration.covariance import Covariance, few_views, invert, lens_doubt
from armsight.calibration.model import Model, State
from armsight.calibration.noise import CUT
from armsight.calibration.solver import Solution, normal_equations

TURN = 0.3
"""A radian of turn between two poses counts as so many metres [m]."""
SMOOTH = (0.45, 0.6)
"""Distance over which errors stay alike [m], and how unsure its logarithm is, before the data."""
RATIO = (2.0, 0.7)
"""Rotation errors over translation errors [rad/m], and how unsure its logarithm is."""
SIZE = (5e-4, 1.5)
"""Translation errors of an unknown arm [m], and how unsure their logarithm is."""
HIDDEN = {"base": (4.4, 3.3), "flange": (1.5, 1.2)}
"""Errors (translation, rotation) that are constant in a mount over those that vary [1]. Of 60
simulated arms whose zeros, lengths and sag are wrong, in the base: translation 2.2 times in the
middle, 1.2 to 4.4 from the tenth to the ninetieth percentile; rotation 1.6, 0.8 to 3.2."""
ALSO = 0.08
"""Share of the variance that looks independent and may yet be alike: few views do not tell [1]."""
CLEAR = 8.0
"""Twice the logarithm by which errors must be likelier alike than not to move the answer."""
TOLD_BY = 60
"""Views that are enough to tell the sizes."""
LOOSE = 1e3
"""Sizes [m], [rad] of errors that no prior holds."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of an arm's errors.

    Attributes:
        smooth: of those alike at like poses (translation [m], rotation [rad]).
        white: of those independent at every pose, likewise.
        length: distance over which the smooth ones stay alike [m].
    """

    smooth: tuple[float, float]
    white: tuple[float, float]
    length: float

    def covariance(self, x: Floats, y: Floats) -> Floats:
        """(6 n, 6 m) of the smooth errors at two sets of poses, given by their places."""
        d = np.linalg.norm(x[:, None] - y[None], axis=-1)
        near = np.exp(-0.5 * (d / self.length) ** 2)
        part = np.diag([self.smooth[0] ** 2] * 3 + [self.smooth[1] ** 2] * 3)
        return np.kron(near, part)

    def scatter(self, n: int) -> Floats:
        """(6 n,) variances of the independent errors."""
        return np.tile([self.white[0] ** 2] * 3 + [self.white[1] ** 2] * 3, n)


@dataclass(frozen=True)
class Measured:
    """What the pictures say of the arm's errors, linear about a solution.

    Attributes:
        x: (n, 9) places of the poses among which errors are smooth.
        error: (6 n,) errors that each view alone tells.
        spread: (n, 6, 6) their covariance from the corners.
        design: (6 n, g) how the unknowns change them.
        information: (g, g) of the unknowns that does not come through the poses; right: (g,).
    """

    x: Floats
    error: Floats
    spread: Floats
    design: Floats
    information: Floats
    right: Floats

    def only(self, k: Ints) -> Measured:
        """Some views only."""
        rows = (6 * k[:, None] + np.arange(6)).ravel()
        return replace(
            self, x=self.x[k], error=self.error[rows], spread=self.spread[k],
            design=self.design[rows],
        )  # fmt: skip


@dataclass(frozen=True)
class Posterior:
    """The unknowns given all views.

    Attributes:
        step: (g,) from the solution; covariance: (g, g).
        likelihood: minus twice the logarithm of the marginal one.
        weights: (6 n,) by which errors elsewhere are foreseen.
    """

    step: Floats
    covariance: Floats
    likelihood: float
    weights: Floats


@dataclass(frozen=True)
class ArmField:
    """An arm's errors as they were told.

    Attributes:
        sizes: of the errors.
        gain: twice the logarithm by which they are likelier so than independent.
        measured: about the solution before; posterior: of it.
        views: (n,) indices of the problem's views.
        before: the solution with independent errors; solution: the answer.
    """

    sizes: Sizes
    gain: float
    measured: Measured
    posterior: Posterior
    views: Ints
    before: Solution
    solution: Solution

    def foreseen(self, view: int) -> tuple[State, Pose]:
        """What a solve without a view says: the unknowns, and the flange's error there."""
        at = int(np.flatnonzero(self.views == view)[0])
        part = self.measured.only(np.delete(np.arange(len(self.views)), at))
        found = posterior(part, self.sizes)
        error = self.sizes.covariance(self.measured.x[[at]], part.x) @ found.weights
        model, state = self.before.model, self.before.state
        step = _full(self.before, found.step)
        moved = model.retract(state, step, np.zeros((len(state.E), 6)))
        return moved, np.asarray(se3.exps(error[None])[0])


def places(T: Poses) -> Floats:
    """(n, 9) coordinates of arm poses in which distance means likeness [m]."""
    return np.concatenate([T[:, :3, 3], TURN * T[:, :3, 0], TURN * T[:, :3, 1]], axis=1)


def fit_field(solution: Solution) -> ArmField | None:
    """An arm's errors as a smooth process, and the solution that it makes.

    Args:
        solution: with independent errors of the arm.

    Returns:
        None where the arm has no errors, or is solved by a model of its own.
    """
    freedom = solution.model.freedom
    if freedom.white is None or freedom.robot:
        return None
    measured, views = measure(solution)
    n = len(views)
    if n < 5:
        return None
    some = measured
    if n > TOLD_BY:
        some = measured.only(np.unique(np.linspace(0, n - 1, TOLD_BY).astype(int)))
    sizes = tell_sizes(some, freedom.white)
    found = posterior(measured, sizes)
    apart = replace(sizes, smooth=(1e-7, 1e-7), white=freedom.white)
    gain = posterior(some, apart).likelihood - posterior(some, sizes).likelihood
    if gain < CLEAR:  # errors that may as well be independent move nothing, but may be alike
        return ArmField(sizes, gain, measured, found, views, solution, solution)
    state = solution.state
    whole = sizes.covariance(measured.x, measured.x) + np.diag(sizes.scatter(n))
    errors = (whole @ found.weights).reshape(n, 6)
    E = state.E.copy()
    E[views] = se3.exps(errors)
    model = solution.model
    new = model.retract(state, _full(solution, found.step), np.zeros((len(E), 6)))
    new = replace(new, E=E)
    normal, residual = normal_equations(model, new, 3.0, CUT)
    answer = replace(solution, state=new, normal=normal, residual=residual)
    return ArmField(sizes, gain, measured, found, views, solution, answer)


def measure(solution: Solution) -> tuple[Measured, Ints]:
    """What each view alone says of the arm's error, and which views those are."""
    old = solution.model
    model = Model(old.problem, replace(old.freedom, white=(LOOSE, LOOSE)), old.priors)
    normal, _ = normal_equations(model, solution.state, 3.0, CUT)
    on = np.trace(old.view_information[normal.views], axis1=1, axis2=2) > 0
    H, g, mixed = normal.H_view[on], normal.gradient_view[on], normal.H_mixed[on]
    views = normal.views[on]
    spread = np.linalg.pinv(H, hermitian=True)
    e = se3.logs(solution.state.E[views]) - np.einsum("vij,vj->vi", spread, g)
    design = spread @ np.swapaxes(mixed, 1, 2)
    others = ~on
    information = normal.H - np.einsum("vgi,vhi->gh", mixed, np.swapaxes(design, 1, 2))
    right = -(normal.gradient - np.einsum("vgi,vij,vj->g", mixed, spread, g))
    if others.any():  # frames of the lens alone: no arm holds them
        M, S = normal.H_mixed[others], np.linalg.pinv(normal.H_view[others], hermitian=True)
        information = information - np.einsum("vgi,vij,vhj->gh", M, S, M)
        right = right + np.einsum("vgi,vij,vj->g", M, S, normal.gradient_view[others])
    T = np.array([old.problem.views[int(v)].T_base_flange for v in views])
    n = len(views)
    return (
        Measured(places(T), e.ravel(), spread, design.reshape(6 * n, -1), information, right),
        views,
    )


def posterior(measured: Measured, sizes: Sizes) -> Posterior:
    """The unknowns when the arm's errors are a process of given sizes."""
    n = len(measured.x)
    sigma = sizes.covariance(measured.x, measured.x) + np.diag(sizes.scatter(n))
    for k in range(n):
        sigma[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += measured.spread[k]
    scale = 1 / np.sqrt(np.diagonal(sigma))
    root = cholesky(sigma * scale[:, None] * scale + 1e-10 * np.eye(6 * n), lower=True)
    both = scale[:, None] * np.column_stack([measured.design, measured.error])
    half = solve_triangular(root, both, lower=True)
    M, y = half[:, :-1], half[:, -1]
    S = measured.information + M.T @ M
    b = measured.right + M.T @ y
    size = 1 / np.sqrt(np.maximum(np.diagonal(S), 1e-12))
    values, vectors = np.linalg.eigh(0.5 * (S + S.T) * size[:, None] * size)
    values = np.maximum(values, 1e-12)
    covariance = (vectors / values) @ vectors.T * size[:, None] * size
    step = covariance @ b
    volume = 2 * float(np.log(np.diagonal(root)).sum()) - 2 * float(np.log(scale).sum())
    volume += float(np.log(values).sum()) - 2 * float(np.log(size).sum())
    likelihood = volume + float(y @ y - b @ step)
    weights = scale * solve_triangular(root, y - M @ step, lower=True, trans="T")
    return Posterior(step, covariance, likelihood, weights)


def tell_sizes(measured: Measured, white: tuple[float, float]) -> Sizes:
    """The sizes of errors under which the measured ones are likeliest, drawn to what is usual.

    Args:
        measured: see there.
        white: sizes of the errors were they independent: where the search starts.
    """

    def sizes_of(p: Floats) -> Sizes:
        s, ratio, w, u, length = np.exp(np.clip(p, -20, 5))
        return Sizes((float(s), float(s * ratio)), (float(w), float(u)), float(length))

    def doubt(p: Floats) -> float:
        s, ratio, w, u, length = p
        usual = (
            (s - np.log(SIZE[0])) ** 2 / SIZE[1] ** 2
            + (ratio - np.log(RATIO[0])) ** 2 / RATIO[1] ** 2
            + (length - np.log(SMOOTH[0])) ** 2 / SMOOTH[1] ** 2
            + (w - np.log(1e-4)) ** 2 / 1.5**2
            + (u - w - np.log(RATIO[0])) ** 2 / RATIO[1] ** 2
        )
        return posterior(measured, sizes_of(p)).likelihood + float(usual)

    start = np.log([
        max(0.8 * white[0], 2e-5), RATIO[0], max(0.4 * white[0], 2e-5), max(0.4 * white[1], 3e-5),
        SMOOTH[0],
    ])  # fmt: skip
    found = minimize(
        doubt, start, method="Nelder-Mead", options={"maxfev": 150, "xatol": 0.03, "fatol": 0.05}
    )
    return sizes_of(np.asarray(found.x, np.float64))


def field_covariance(field: ArmField) -> Covariance:
    """Covariance of an answer whose arm errs smoothly: few views make its sizes unsure, too."""
    solution = field.solution
    free = solution.normal.free
    G = solution.model.size
    out = np.zeros((G, G))
    out[np.ix_(free, free)] = few_views(len(field.views)) * field.posterior.covariance
    out = out + lens_doubt(solution, invert(solution.normal.reduced())) + _unseen(field)
    return Covariance(solution, out, out, solution.chi2_share)


def _unseen(field: ArmField) -> Floats:
    """(G, G) what the errors do that are alike at all poses, and that no picture shows.

    A displacement that is constant in the base looks like another place of what stands in the base,
    one that is constant in the flange like another place of what the flange carries. How large they
    are is known only by those that vary.
    """
    model = field.solution.model
    state, x, sizes = field.solution.state, field.measured.x, field.sizes
    d = np.linalg.norm(x[:, None] - x[None], axis=-1)
    alike = float(np.exp(-0.5 * (d / sizes.length) ** 2).mean())
    middle = np.eye(4)
    middle[:3, 3] = x[:, :3].mean(0)
    out = np.zeros((model.size, model.size))
    parts = [(model.rig_slice(k), r.mount, state.T_mount_rig[k])
             for k, r in enumerate(model.problem.rigs)]  # fmt: skip
    parts += [(model.board_slice(k), b.mount, state.T_mount_board[k])
              for k, b in enumerate(model.problem.boards)]  # fmt: skip
    for mount, times in HIDDEN.items():
        mine = [(at, T) for at, m, T in parts if m == mount]
        if not mine:
            continue
        variance = [
            max(c * c * (s * s * (1 - alike) + ALSO * w * w) - s * s * alike, 0.0)
            for s, w, c in zip(sizes.smooth, sizes.white, times)
        ]
        from_middle = middle if mount == "base" else np.eye(4)
        # Everything in one mount is displaced alike: cameras of a pair stay where they are.
        at = np.concatenate([np.arange(a.start, a.stop) for a, _ in mine])
        A = np.concatenate(
            [se3.adjoints((se3.inverses(T[None])[0] @ from_middle)[None])[0] for _, T in mine]
        )
        out[np.ix_(at, at)] += A @ np.diag([variance[0]] * 3 + [variance[1]] * 3) @ A.T
    return out


def _full(solution: Solution, step: Floats) -> Floats:
    out = np.zeros(solution.model.size)
    out[solution.normal.free] = step
    return out
