"""Robust least squares for the measurement model: Levenberg-Marquardt with the poses eliminated.

Each arm pose's own error, and each freely held board's pose, touches only its own view; it is
eliminated by a Schur complement, so that the system to solve has about a hundred unknowns however
many views there are (docs/calibration.md). Everything is scaled to unit diagonal before it is
inverted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.calibration import se3
from armsight.calibration.model import Model, State


@dataclass(frozen=True)
class SolverOptions:
    """How to solve.

    Attributes:
        huber: corners farther off than this many sigma count less [1]; inf for plain squares.
        cut: corners farther off than this do not count at all [1]; only for a start that is near.
        iterations: at most.
        tolerance: stop when a step lowers the cost by less than this share.
    """

    huber: float = 3.0
    cut: float = float("inf")
    iterations: int = 60
    tolerance: float = 1e-10


@dataclass(frozen=True)
class NormalEquations:
    """Second-order picture of the cost about a state, over the free unknowns.

    Attributes:
        free: (g,) indices of the global unknowns that may move.
        H: (g, g) information of data and priors; gradient: (g,).
        views: (v,) views with a pose unknown.
        H_view: (v, 6, 6) their information; gradient_view: (v, 6).
        H_mixed: (v, g, 6) between both.
        scores: (V, g) share of each view in the data's gradient, for the sandwich.
        cost: half the robust sum of squares; chi2: plain sum of squares of the inliers.
        weight: (F, K) robust weight of each corner.
    """

    free: Ints
    H: Floats
    gradient: Floats
    views: Ints
    H_view: Floats
    gradient_view: Floats
    H_mixed: Floats
    scores: Floats
    cost: float
    weight: Floats

    def reduced(self) -> Floats:
        """(g, g) information of the global unknowns after elimination of the views."""
        if not len(self.views):
            return self.H
        return self.H - _product(self.H_mixed, _solve_views(self.H_view, self.H_mixed))


@dataclass(frozen=True)
class Solution:
    """Where the solver ended.

    Attributes:
        model: what was solved; state: the answer; normal: the picture about it.
        residual: (F, K, 2) whitened residuals at the answer (0 where nothing was seen).
        iterations: rounds taken; converged: whether it ended by itself.
    """

    model: Model
    state: State
    normal: NormalEquations
    residual: Floats
    iterations: int
    converged: bool

    @property
    def pixel_errors(self) -> Floats:
        """(n, 2) predicted minus seen of every corner [px]."""
        raw = self.residual * self.model.sigma[:, None, None]
        return np.asarray(raw[self.model.seen])

    def rms_px(self, lens: int | None = None) -> float:
        """Root mean square distance of the corners that count [px], through one lens or all."""
        raw = self.residual * self.model.sigma[:, None, None]
        mask = self.model.seen & (self.normal.weight > 0)
        if lens is not None:
            mask = mask & (self.model.lens_of == lens)[:, None]
        d = raw[mask]
        return float(np.sqrt(np.mean(np.sum(d * d, axis=-1)))) if len(d) else float("nan")

    @property
    def dropped(self) -> int:
        """Corners that do not count: they lie on another thing."""
        return int(np.sum(self.model.seen & (self.normal.weight == 0)))

    def freedom_left(self) -> int:
        """Residuals minus unknowns that no prior holds."""
        model = self.model
        loose = np.diag(model.prior_information)[self.normal.free] == 0
        boards_free = np.sum(
            np.trace(model.view_information[self.normal.views], axis1=1, axis2=2) == 0
        )
        counted = int(np.sum(model.seen & (self.normal.weight > 0)))
        return int(2 * counted - loose.sum() - 6 * boards_free)

    @property
    def chi2_share(self) -> float:
        """Sum of squares over degrees of freedom, outliers capped: 1 when the noise is as said."""
        r2 = np.sum(self.residual**2, axis=-1) * self.normal.weight
        # A Gaussian cut at 3 sigma keeps 1 - exp(-4.5) of its corners' squares.
        dof = max(self.freedom_left(), 1)
        e = (
            se3.logs(self.state.E[self.normal.views])
            if len(self.normal.views)
            else np.zeros((0, 6))
        )
        W = self.model.view_information[self.normal.views]
        prior = float(np.einsum("vi,vij,vj->", e, W, e))
        d = self.model.prior_residual(self.state)[self.normal.free]
        P = self.model.prior_information[np.ix_(self.normal.free, self.normal.free)]
        return float((r2.sum() + prior + d @ P @ d) / dof)


def _sums(places: Ints, values: Floats, size: int) -> Floats:
    """(size,) sums of the values that go to each place."""
    return np.asarray(np.bincount(places, values.ravel(), size), np.float64)


def robust_weights(
    residual: Floats, threshold: float, cut: float = float("inf")
) -> tuple[Floats, float]:
    """Weights of corners and the robust cost of (F, K, 2) whitened residuals.

    Huber's cost up to ``cut`` sigma, constant from there on (a corner on another thing).
    """
    square = np.sum(residual * residual, axis=-1)
    if not np.isfinite(threshold):
        return np.ones_like(square), 0.5 * float(square.sum())
    length = np.minimum(np.sqrt(square), cut)
    far = length > threshold
    weight = np.where(far, threshold / np.maximum(length, 1e-300), 1.0)
    cost = np.where(far, threshold * length - 0.5 * threshold**2, 0.5 * square)
    return np.where(length < cut, weight, 0.0), float(cost.sum())


def cost_of(
    model: Model, state: State, residual: Floats, huber: float, cut: float = float("inf")
) -> float:
    """Half the robust sum of squares, priors included."""
    _, cost = robust_weights(residual, huber, cut)
    d = model.prior_residual(state)
    d = np.where(model.free, d, 0.0)
    cost += 0.5 * float(d @ model.prior_information @ d)
    views = np.flatnonzero(
        model.view_free & (np.trace(model.view_information, axis1=1, axis2=2) > 0)
    )
    if len(views):
        e = se3.logs(state.E[views])
        cost += 0.5 * float(np.einsum("vi,vij,vj->", e, model.view_information[views], e))
    return cost


def normal_equations(
    model: Model, state: State, huber: float, cut: float = float("inf")
) -> tuple[NormalEquations, Floats]:
    """The normal equations about a state, and its residuals."""
    lin = model.linearise(state)
    weight, _ = robust_weights(lin.residual, huber, cut)
    F, K = weight.shape
    root = np.sqrt(weight)[..., None]
    J = (lin.jacobian * root[..., None]).reshape(F, 2 * K, -1)
    r = (lin.residual * root).reshape(F, 2 * K)
    N = np.swapaxes(J, 1, 2) @ J
    g = np.einsum("fnp,fn->fp", J, r)
    P = model.columns.shape[1]
    G, V = model.size, len(model.view_free)

    columns = model.columns
    flat = (columns[:, :, None] * G + columns[:, None, :]).ravel()
    H = _sums(flat, N[:, :P, :P], G * G).reshape(G, G) + model.prior_information
    by_view = (model.view_of[:, None] * G + columns).ravel()
    scores = _sums(by_view, g[:, :P], V * G).reshape(V, G)
    d = np.where(model.free, model.prior_residual(state), 0.0)
    gradient = scores.sum(0) + model.prior_information @ d

    mixed_at = ((model.view_of[:, None, None] * G + columns[:, :, None]) * 6 + np.arange(6)).ravel()
    mixed = _sums(mixed_at, N[:, :P, P:], V * G * 6).reshape(V, G, 6)
    H_view = np.zeros((V, 6, 6))
    np.add.at(H_view, model.view_of, N[:, P:, P:])
    g_view = np.zeros((V, 6))
    np.add.at(g_view, model.view_of, g[:, P:])

    free = np.flatnonzero(model.free)
    views = np.flatnonzero(model.view_free)
    W = model.view_information[views]
    H_view, g_view = H_view[views], g_view[views]
    if len(views):
        e = se3.logs(state.E[views])
        D = se3.log_derivatives(e)
        on = np.trace(W, axis1=1, axis2=2) > 0
        WD = W @ np.where(on[:, None, None], D, 0.0)
        H_view = H_view + np.swapaxes(D, 1, 2) @ WD * on[:, None, None]
        g_view = g_view + np.einsum("vji,vj->vi", WD, np.where(on[:, None], e, 0.0))
    normal = NormalEquations(
        free,
        H[np.ix_(free, free)],
        gradient[free],
        views,
        H_view,
        g_view,
        mixed[np.ix_(views, free)] if len(views) else np.zeros((0, len(free), 6)),
        scores[:, free],
        cost_of(model, state, lin.residual, huber, cut),
        weight,
    )
    return normal, lin.residual


def solve(
    model: Model, state: State | None = None, options: SolverOptions | None = None
) -> Solution:
    """Minimise the robust cost from a start state.

    Raises:
        ValueError: there is nothing to solve: no sighting.
    """
    options = options or SolverOptions()
    if model.count == 0:
        raise ValueError("no sighting of a board: nothing to solve")
    state = state or model.start()
    robust = (options.huber, options.cut)
    normal, residual = normal_equations(model, state, *robust)
    damping, converged, rounds = 1e-4, False, 0
    while rounds < options.iterations and np.isfinite(normal.cost):
        rounds += 1
        step, view_step = _step(normal, damping)
        trial = model.retract(
            state, _spread(model, normal, step), _spread_views(model, normal, view_step)
        )
        cost = cost_of(model, trial, model.linearise(trial, False).residual, *robust)
        if not np.isfinite(cost) or cost > normal.cost * (1 + 1e-14):
            if damping > 1e12:
                converged = True  # no direction lowers the cost: this is the bottom
                break
            damping *= 8.0
            continue
        gain = (normal.cost - cost) / max(normal.cost, 1e-300)
        state = trial
        normal, residual = normal_equations(model, state, *robust)
        damping = max(damping / 10.0, 1e-12)
        if gain < options.tolerance or normal.cost < 1e-24:
            converged = True
            break
    return Solution(model, state, normal, residual, rounds, converged)


def _step(normal: NormalEquations, damping: float) -> tuple[Floats, Floats]:
    scale = _unit(np.diagonal(normal.H))
    H = normal.H * scale[:, None] * scale
    H[np.diag_indices_from(H)] += damping
    g = normal.gradient * scale
    if not len(normal.views):
        return -scale * _solve(H, g), np.zeros((0, 6))
    view_scale = _unit(np.diagonal(normal.H_view, axis1=1, axis2=2))
    H_view = normal.H_view * view_scale[:, :, None] * view_scale[:, None, :]
    H_view[:, np.arange(6), np.arange(6)] += damping
    g_view = normal.gradient_view * view_scale
    mixed = normal.H_mixed * scale[:, None] * view_scale[:, None, :]
    Y = _solve_views(H_view, mixed)
    S = H - _product(mixed, Y)
    z = np.linalg.solve(H_view, g_view[..., None])[..., 0]
    x = -_solve(S, g - np.einsum("vgi,vi->g", mixed, z))
    y = -z - np.einsum("vig,g->vi", Y, x)
    return scale * x, view_scale * y


def _solve_views(H_view: Floats, mixed: Floats) -> Floats:
    """(v, 6, g) inv(H_view) mixed^T."""
    return np.asarray(np.linalg.solve(H_view, np.swapaxes(mixed, 1, 2)), np.float64)


def _product(mixed: Floats, Y: Floats) -> Floats:
    """(g, g) sum over views of mixed Y, as one product."""
    g = mixed.shape[1]
    if not g:  # only poses are sought
        return np.zeros((0, 0))
    return np.swapaxes(mixed, 0, 1).reshape(g, -1) @ Y.reshape(-1, g)


def _solve(H: Floats, g: Floats) -> Floats:
    if not len(g):
        return g
    try:
        return np.asarray(np.linalg.solve(H, g), np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(H, g, rcond=None)[0], np.float64)


def _unit(diagonal: Floats) -> Floats:
    return 1.0 / np.sqrt(np.where(diagonal > 1e-300, diagonal, 1.0))


def _spread(model: Model, normal: NormalEquations, step: Floats) -> Floats:
    full = np.zeros(model.size)
    full[normal.free] = step
    return full


def _spread_views(model: Model, normal: NormalEquations, step: Floats) -> Floats:
    full = np.zeros((len(model.view_free), 6))
    full[normal.views] = step
    return full
