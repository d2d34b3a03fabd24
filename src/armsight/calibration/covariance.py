"""How sure an answer is: covariance of the unknowns, and of any point seen through a lens.

Two estimates are made. One believes the noise model and scales it by what the residuals say; the
other (the sandwich, clustered by view) believes only that views are independent. They differ when
the model is wrong; the larger is reported (docs/calibration.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.calibration.model import project
from armsight.calibration.problem import lens_from_vector
from armsight.calibration.solver import Solution
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


def covariance(solution: Solution) -> Covariance:
    """Both covariances of a solution's global unknowns."""
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
    G = model.size
    full_model, full_sandwich = np.zeros((G, G)), np.zeros((G, G))
    at = np.ix_(normal.free, normal.free)
    full_model[at] = S_inv * max(share, 1.0)
    full_sandwich[at] = sandwich
    return Covariance(solution, full_model, full_sandwich, share)


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
