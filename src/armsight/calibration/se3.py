"""SE(3) for stacks of poses: exponential, logarithm, adjoint; twists have translation first."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Pose, Poses
from armsight.geometry.pose import skews


def inverses(T: Poses) -> Poses:
    """(..., 4, 4) inverses."""
    out = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def exps(twists: Floats) -> Poses:
    """(n, 4, 4) exponentials of (n, 6) twists."""
    xi = np.atleast_2d(twists)
    phi = xi[:, 3:]
    angle = np.linalg.norm(phi, axis=1)[:, None, None]
    small = angle < 1e-6
    a = np.where(small, 1.0, angle)
    K = skews(phi)
    KK = K @ K
    B = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(a)) / a**2)
    C = np.where(small, 1 / 6 - angle**2 / 120, (a - np.sin(a)) / a**3)
    A = np.where(small, 1 - angle**2 / 6, np.sin(a) / a)
    T = np.zeros((len(xi), 4, 4))
    T[:, :3, :3] = np.eye(3) + A * K + B * KK
    T[:, :3, 3] = np.einsum("nij,nj->ni", np.eye(3) + B * K + C * KK, xi[:, :3])
    T[:, 3, 3] = 1.0
    return T


def logs(T: Poses) -> Floats:
    """(n, 6) twists of (n, 4, 4) poses, rotations below pi."""
    phi = rotation_vectors(T[:, :3, :3])
    angle = np.linalg.norm(phi, axis=1)[:, None, None]
    small = angle < 1e-4
    half = np.where(small, 0.5, 0.5 * angle)
    C = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    K = skews(phi)
    V_inv = np.eye(3) - 0.5 * K + C * (K @ K)
    return np.concatenate([np.einsum("nij,nj->ni", V_inv, T[:, :3, 3]), phi], axis=1)


def rotation_vectors(R: Floats) -> Floats:
    """(n, 3) rotation vectors of (n, 3, 3) rotations [rad].

    By their skew part, which is fast and exact but near half a turn: those go to scipy.
    """
    v = 0.5 * np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
    )
    sine = np.sqrt(np.einsum("ni,ni->n", v, v))
    cosine = 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    small = sine < 1e-7
    angle = np.arctan2(sine, cosine)
    out = v * np.where(small, 1.0, angle / np.where(small, 1.0, sine))[:, None]
    far = cosine < -0.9
    if far.any():
        out[far] = Rotation.from_matrix(R[far]).as_rotvec()
    return np.asarray(out, np.float64)


def adjoints(T: Poses) -> Floats:
    """(n, 6, 6) with ``T exp(x) inv(T) = exp(Ad(T) x)``."""
    out = np.zeros((len(T), 6, 6))
    R = T[:, :3, :3]
    out[:, :3, :3] = R
    out[:, 3:, 3:] = R
    out[:, :3, 3:] = skews(T[:, :3, 3]) @ R
    return out


def carried(T: Pose, covariance: Floats) -> Floats:
    """(6, 6) covariance of a twist d seen in another frame: that of ``Ad(T) d``."""
    adjoint = adjoints(T[None])[0]
    out = adjoint @ covariance @ adjoint.T
    return np.asarray(0.5 * (out + out.T))


def log_derivatives(twists: Floats) -> Floats:
    """(n, 6, 6) derivative of ``log(exp(x) exp(d))`` by d at 0, to second order in x.

    The series of the inverse right Jacobian: I + ad/2 + ad^2/12; x here is an arm's error of
    milliradians, so the rest is below 1e-9.
    """
    ad = np.zeros((len(twists), 6, 6))
    W = skews(twists[:, 3:])
    ad[:, :3, :3] = W
    ad[:, 3:, 3:] = W
    ad[:, :3, 3:] = skews(twists[:, :3])
    return np.eye(6) + 0.5 * ad + ad @ ad / 12.0
