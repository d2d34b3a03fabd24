"""A solution seen as one pose error a view: the small linear problem behind many questions.

Each view tells by how much the flange would have to be displaced to explain its pictures exactly
(six numbers, in the flange's axes) and how surely. Moving what the flange carries displaces all
views alike; moving what stands in the base displaces view i by ``Ad(inv(T_base_flange_i))``. So
hand-eye calibration about its answer is the linear regression ``y_i = M_i delta + e_i`` with
``M_i = [I, Ad(inv(A_i))]``, for either mount.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.calibration import se3
from armsight.calibration.model import Model
from armsight.calibration.problem import Sighting
from armsight.calibration.solver import Solution

LOOSE = 0.3
"""Sigma beyond which a view tells nothing about a direction [m], [rad]."""


@dataclass(frozen=True)
class PoseErrors:
    """What each view says of the arm.

    Attributes:
        view: (n,) index of each view in the problem.
        shift: (n, 6) displacement of the flange that explains its pictures (translation [m],
            rotation [rad], flange axes).
        seen: (n, 6, 6) covariance of that by the corners alone.
        arm: (6, 6) covariance of the arm's independent error, as these views tell it.
        design: (n, 6, 12) ``[I, Ad(inv(A))]``.
    """

    view: Ints
    shift: Floats
    seen: Floats
    arm: Floats
    design: Floats

    def whitened(self) -> tuple[Floats, Floats, Floats]:
        """(n, 6) residuals after the regression, (n, 6, 12) design, (n, 6, 6) whitening roots."""
        root = _roots(self.seen + self.arm)
        y = np.einsum("nij,nj->ni", root, self.shift)
        M = root @ self.design
        delta = np.linalg.lstsq(M.reshape(-1, 12), y.ravel(), rcond=1e-9)[0]
        return y - M @ delta, M, root


def _roots(covariance: Floats) -> Floats:
    """(n, 6, 6) with ``root @ covariance @ root.T = I``."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(
        np.swapaxes(vectors, 1, 2) / np.sqrt(np.maximum(values, 1e-18))[..., None], np.float64
    )


def pose_errors(solution: Solution, rig: int, more: Sequence[Sighting] = ()) -> PoseErrors | None:
    """Every arm view of a rig as a pose error; None with fewer than four views.

    The arm's own scatter is told from the same residuals by expectation maximisation, so that an
    arm good to 3 mm is judged as such an arm.

    Args:
        solution: with any error model.
        rig: the camera.
        more: sightings that the solve left out, to be looked at as well.
    """
    old = solution.model
    sigma = float(np.median(old.sigma))
    extra = tuple(replace(s, sigma=sigma) for s in more)
    problem = replace(old.problem, sightings=(*old.problem.sightings, *extra))
    model = Model(problem, replace(old.freedom, white=None), old.priors)
    lin = model.linearise(old.with_exact_views(solution.state))
    r = lin.residual.reshape(model.count, -1)
    B = lin.jacobian[..., -6:].reshape(model.count, r.shape[1], 6)
    views: dict[int, tuple[Floats, Floats]] = {}
    for f in np.flatnonzero(model.rig_of == rig):
        v = int(model.view_of[f])
        if model.problem.views[v].free:
            continue
        H, g = views.get(v, (np.zeros((6, 6)), np.zeros(6)))
        views[v] = (H + B[f].T @ B[f], g + B[f].T @ r[f])
    if len(views) < 4:
        return None
    order = np.array(sorted(views), np.int64)
    H = np.array([views[int(v)][0] for v in order]) + np.eye(6) / LOOSE**2
    g = np.array([views[int(v)][1] for v in order])
    seen = np.linalg.inv(H)
    shift = -np.einsum("nij,nj->ni", seen, g)
    arm, _ = model.arm_poses(old.with_exact_views(solution.state))
    n = len(order)
    design = np.concatenate(
        [np.tile(np.eye(6), (n, 1, 1)), se3.adjoints(se3.inverses(arm[order]))], axis=2
    )
    return with_arm_scatter(
        PoseErrors(order, shift, np.asarray(seen, np.float64), np.zeros((6, 6)), design)
    )


def with_arm_scatter(errors: PoseErrors, rounds: int = 40) -> PoseErrors:
    """The same with the arm's scatter told (one variance for translation, one for rotation)."""
    n = len(errors.view)
    spent = 6 * n / max(6 * n - 12, 6)
    variance = np.array([1e-7, 1e-7])
    for _ in range(rounds):
        arm = np.diag(np.repeat(variance, 3))
        trial = replace(errors, arm=arm)
        u, _, root = trial.whitened()
        raw = np.linalg.solve(root, u[..., None])[..., 0]
        # A view far off (a wrong pose) may not make a good arm look bad.
        u2 = np.sum(u**2, axis=1)
        trust = np.minimum(1.0, 3.0 * np.median(u2) / np.maximum(u2, 1e-12))
        gain = arm @ np.linalg.inv(errors.seen + arm)
        e = np.einsum("nij,nj->ni", gain, raw)
        left = np.diagonal(arm - gain @ arm, axis1=1, axis2=2)
        second = (trust[:, None] * spent * e**2 + left).mean(0)
        new = np.maximum([second[:3].mean(), second[3:].mean()], [1e-12, 1e-12])
        if np.all(np.abs(np.log(new / variance)) < 0.01):
            variance = new
            break
        variance = new
    return replace(errors, arm=np.diag(np.repeat(variance, 3)))
