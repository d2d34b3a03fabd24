"""How sure an answer is: covariance of the unknowns, and of any point seen through a lens.

Two estimates are made. One believes the noise model and scales it by what the residuals say; the
other (the sandwich, clustered by view) believes only that views are independent. They differ when
the model is wrong; the larger is reported (docs/calibration.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, fdtri

from armsight.arrays import Floats, Ints
from armsight.calibration.model import Model
from armsight.calibration.problem import lens_from_vector
from armsight.calibration.projection import project
from armsight.calibration.solver import Solution, normal_equations
from armsight.geometry.pose import skews


@dataclass(frozen=True)
class Covariance:
    """Covariance of the global unknowns of a solution.

    Attributes:
        solution: what it is about.
        model: (G, G) by the noise model times chi squared; sandwich: (G, G) by the views' scatter.
            Rows and columns of what was not solved are zero.
        chi2_share: sum of squares over degrees of freedom.
    """

    solution: Solution
    model: Floats
    sandwich: Floats
    chi2_share: float

    def block(self, at: slice | Ints) -> Floats:
        """Covariance of some unknowns: of both estimates, the one with the larger trace."""
        a, b = self.model[at][:, at], self.sandwich[at][:, at]
        scale = 1 / np.sqrt(np.maximum(np.diagonal(a), 1e-300))
        larger_sandwich = np.trace(b * scale[:, None] * scale) > np.trace(
            a * scale[:, None] * scale
        )
        return b if larger_sandwich else a

    def sigma(self) -> Floats:
        """(G,) standard deviation of each unknown, of the larger estimate."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.model), np.diagonal(self.sandwich))))

    def camera_pose(self, rig: int) -> Floats:
        """(6, 6) of a camera's pose (translation [m], rotation [rad], in the camera's axes)."""
        return self.block(self.solution.model.rig_slice(rig))

    def points(self, lens: int, pixels: Floats, depth: Floats) -> Floats:
        """(t, 3, 3) covariance in the mount's frame of points given by pixel and true depth [m^2].

        Args:
            lens: index.
            pixels: (t, 2) [px].
            depth: (t,) along the optical axis [m].
        """
        D = point_derivatives(self.solution, lens, pixels, depth)
        a = np.einsum("tig,gh,tjh->tij", D, self.model, D, optimize=True)
        b = np.einsum("tig,gh,tjh->tij", D, self.sandwich, D, optimize=True)
        return b if np.trace(b, axis1=1, axis2=2).sum() > np.trace(a, axis1=1, axis2=2).sum() else a

    def target_sigma(self, lens: int, pixels: Floats, depth: Floats) -> float:
        """Expected 3D rms error of such points [m]: the square root of the mean trace."""
        return float(np.sqrt(np.mean(np.trace(self.points(lens, pixels, depth), axis1=1, axis2=2))))


def covariance(solution: Solution, stranger: bool = False) -> Covariance:
    """Both covariances of a solution's global unknowns.

    Args:
        solution: of a solve.
        stranger: the arm and the lens are somebody else's: errors of similar poses are alike, and
            a lens that was not solved is as unsure as its prior says.
    """
    normal, model = solution.normal, solution.model
    S_inv = invert(normal.reduced())
    share = solution.chi2_share
    # By elimination of its pose, a view's score is g_x - H_xi inv(H_ii) g_i.
    scores = normal.scores.copy()
    if len(normal.views):
        z = np.linalg.solve(normal.H_view, normal.gradient_view[..., None])[..., 0]
        scores[normal.views] -= np.einsum("vgi,vi->vg", normal.H_mixed, z)
    used = np.unique(model.view_of)
    scores = scores[used]
    n = len(used)
    scores = scores - scores.mean(0)
    # Unknowns take away from the scatter of the scores, as in an ordinary regression.
    spent = min(len(normal.free) / max(2 * model.seen.sum() / max(n, 1), 1.0), n - 1.5)
    meat = scores.T @ scores * (n / max(n - 1.0 - max(spent, 0.0), 0.5)) if n > 1 else 0.0
    # The priors are known to be right; only the data's share of the information is in doubt.
    prior = model.prior_information[np.ix_(normal.free, normal.free)]
    sandwich = S_inv @ (meat + prior) @ S_inv
    own = S_inv * max(share, 1.0)
    if stranger:
        common = S_inv @ common_errors(solution) @ S_inv
        factor = few_views(n)
        own, sandwich = factor * (own + common), factor * (sandwich + common)
    G = model.size
    full_model, full_sandwich = np.zeros((G, G)), np.zeros((G, G))
    at = np.ix_(normal.free, normal.free)
    full_model[at], full_sandwich[at] = own, sandwich
    if stranger:
        doubt = lens_doubt(solution, S_inv)
        full_model, full_sandwich = full_model + doubt, full_sandwich + doubt
    return Covariance(solution, full_model, full_sandwich, share)


ALIKE = 0.6
"""Share of an arm's error variance that is the same at the same pose [1]."""
NEAR = 0.4
"""Distance over which it stays alike; a radian counts as 0.3 m [m]."""


def common_errors(solution: Solution) -> Floats:
    """(g, g) what errors that similar poses share add to the scores' covariance.

    An unmodelled arm errs alike at like poses (zeros, lengths, sag): twenty views from one corner
    tell little more than five. Errors of two views are correlated by ``ALIKE exp(-(d / NEAR)^2)``;
    the independent share is in the solve already. An arm whose kinematics were solved has nothing
    but its repeatability left.
    """
    normal, model = solution.normal, solution.model
    g = len(normal.free)
    on = np.trace(model.view_information[normal.views], axis1=1, axis2=2) > 0
    if model.freedom.robot or not on.any():
        return np.zeros((g, g))
    views = normal.views[on]
    W = model.view_information[views]
    T = np.array([model.problem.views[int(v)].T_base_flange for v in views])
    x = np.concatenate([T[:, :3, 3], 0.3 * T[:, :3, 0], 0.3 * T[:, :3, 1]], axis=1)
    d = np.linalg.norm(x[:, None] - x[None], axis=-1)
    rho = ALIKE * np.exp(-((d / NEAR) ** 2))
    np.fill_diagonal(rho, 0.0)
    # An error e of the arm moves the scores by H_xi inv(H_ii) W e.
    P = normal.H_mixed[on] @ np.linalg.solve(normal.H_view[on], np.sqrt(W))
    out = np.einsum("vgi,vw,whi->gh", P, rho, P, optimize=True)
    values, vectors = np.linalg.eigh(0.5 * (out + out.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, np.float64)


FEW = 8
"""Views below which sigmas are a rough guess."""


def few_views(views: int) -> float:
    """By how much a 95 % ellipsoid of six numbers grows because the scatter is told by few views.

    Hotelling's: F(6, m) times six over chi squared(6), with m = 6 n - 12 degrees of freedom of the
    pose errors. Below eight views that is not enough: of 48 simulated sets of four to seven views
    15 % lay outside (2 % with twice the variance).
    """
    left = max(6 * views - 12, 4)
    return float((2 if views < FEW else 1) * 6 * fdtri(6, left, 0.95) / chdtri(6, 0.05))


def lens_doubt(solution: Solution, S_inv: Floats) -> Floats:
    """(G, G) what an unsure lens that was not solved adds: its prior, carried to the unknowns.

    Consider covariance (Schmidt, 1966): delta x = -inv(S_xx) S_xl delta l.
    """
    model = solution.model
    G = model.size
    out = np.zeros((G, G))
    held = [
        k
        for k, lens in enumerate(model.problem.lenses)
        if lens.prior is not None and (lens.keep or not model.freedom.lens) and k in model.lens_of
    ]
    if not held:
        return out
    lenses = tuple(replace(lens, keep=False) for lens in model.problem.lenses)
    trial = Model(
        replace(model.problem, lenses=lenses), replace(model.freedom, lens=True), model.priors
    )
    normal, _ = normal_equations(trial, solution.state, 3.0)
    S = np.zeros((G, G))
    S[np.ix_(normal.free, normal.free)] = normal.reduced()
    free = solution.normal.free
    for k in held:
        at = np.arange(9 * k, 9 * k + 9)
        prior = model.problem.lenses[k].prior
        assert prior is not None
        P = invert(prior)
        move = np.zeros((G, 9))
        move[free] = -S_inv @ S[np.ix_(free, at)]
        move[at] = np.eye(9)
        out += move @ P @ move.T
    return out


def invert(S: Floats) -> Floats:
    """Inverse of an information matrix after scaling to unit diagonal.

    Directions without information get a huge variance rather than an error.
    """
    if not len(S):
        return S
    # A sigma of a million metres, radians or pixels is none; smaller figures only overflow.
    scale = 1 / np.sqrt(np.maximum(np.diagonal(S), 1e-12))
    values, vectors = np.linalg.eigh(0.5 * (S + S.T) * scale[:, None] * scale)
    inverse = (vectors / np.maximum(values, 1e-13)) @ vectors.T
    return np.asarray(inverse * scale[:, None] * scale)


def point_derivatives(solution: Solution, lens: int, pixels: Floats, depth: Floats) -> Floats:
    """(t, 3, G) how a point given by pixel and depth moves in the mount's frame."""
    model, state = solution.model, solution.state
    definition = model.problem.lenses[lens]
    rig = definition.rig
    camera = lens_from_vector(state.lens[lens], definition.camera.width, definition.camera.height)
    z = np.asarray(depth, float)
    ray = np.column_stack([camera.normalise(np.asarray(pixels, float)), np.ones(len(z))])
    p = ray * z[:, None]
    T_rig_lens, T_mount_rig = state.T_rig_lens[lens], state.T_mount_rig[rig]
    _, d_point, d_lens = project(p[None], state.lens[lens][None])
    # A pixel that stays while the lens changes: d_xy = -inv(d pixel / d xy) d pixel / d lens.
    d_xy = -np.linalg.solve(d_point[0][:, :, :2], d_lens[0])
    D = np.zeros((len(z), 3, model.size))
    R = T_mount_rig[:3, :3] @ T_rig_lens[:3, :3]
    D[:, :, model.lens_slice(lens)] = np.einsum("ij,tjk->tik", R[:, :2], d_xy)
    at_rig = p @ T_rig_lens[:3, :3].T + T_rig_lens[:3, 3]
    D[:, :, model.offset_slice(lens)] = np.einsum("ij,tjk->tik", R, _moves(p))
    D[:, :, model.rig_slice(rig)] = np.einsum("ij,tjk->tik", T_mount_rig[:3, :3], _moves(at_rig))
    return D


def _moves(points: Floats) -> Floats:
    """(t, 3, 6) motion of points under ``exp(d)``."""
    out = np.zeros((len(points), 3, 6))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:] = -skews(points)
    return out


def weakest_direction(solution: Solution, rig: int) -> tuple[float, str]:
    """The least certain direction of a camera's pose: its sigma [m at 1 m distance] and words."""
    cov = covariance(solution).camera_pose(rig)
    values, vectors = np.linalg.eigh(cov)  # a radian at one metre moves a point by one metre
    v = vectors[:, -1]
    axes = ("sideways", "up and down", "along the view", "pitch", "yaw", "roll")
    return float(np.sqrt(max(values[-1], 0.0))), axes[int(np.argmax(np.abs(v)))]
