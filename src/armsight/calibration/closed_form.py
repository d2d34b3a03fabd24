"""Closed forms for the hand-eye equation ``A_i Z = X C_i``: the start of every solve.

For a camera on ``base`` and a board on ``flange``: A_i = T_base_flange, Z = T_flange_board,
X = T_base_camera, C_i = T_camera_board. For a camera on the flange and a board on the base,
A_i = T_flange_base, Z = T_base_board, X = T_flange_camera: the same equation.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Pose, Poses, Rotation3
from armsight.calibration import se3


def nearest_rotation(M: Floats) -> Rotation3:
    """The rotation nearest to a (3, 3) matrix in the Frobenius norm."""
    U, _, V_t = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V_t))]) @ V_t)


def mean_pose(T: Poses) -> Pose:
    """Chordal mean of (n, 4, 4) poses."""
    out = np.eye(4)
    out[:3, :3] = nearest_rotation(T[:, :3, :3].sum(0))
    out[:3, 3] = T[:, :3, 3].mean(0)
    return out


def shah(A: Poses, C: Poses) -> tuple[Pose, Pose]:
    """X and Z by Kronecker products and one singular value decomposition.

    M. Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product",
    J. Mechanisms Robotics 5(3), 2013.

    Args:
        A: (n, 4, 4) poses of the arm.
        C: (n, 4, 4) poses of the board in the camera.

    Returns:
        X, Z with ``A_i Z = X C_i``.
    """
    R_A, R_C = A[:, :3, :3], C[:, :3, :3]
    # R_A R_Z R_C^T = R_X: in row-major vectors, kron(R_A, R_C) vec(R_Z) = vec(R_X).
    K = np.einsum("nij,nkl->ikjl", R_A, R_C).reshape(9, 9)
    U, _, V_t = np.linalg.svd(K)
    Z0, X0 = V_t[0].reshape(3, 3), U[:, 0].reshape(3, 3)
    sign = np.sign(np.linalg.det(Z0)) or 1.0
    R_Z, R_X = nearest_rotation(sign * Z0), nearest_rotation(sign * X0)
    return _translations(A, C, R_X, R_Z)


def park(A: Poses, C: Poses) -> tuple[Pose, Pose]:
    """X and Z from the relative motions of all pairs of views, on the Lie group.

    F. Park and B. Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group",
    IEEE Trans. Robotics and Automation 10(5), 1994.
    """
    i, j = np.triu_indices(len(A), 1)
    M = se3.inverses(A[j]) @ A[i]  # M Z = Z N
    N = se3.inverses(C[j]) @ C[i]
    alpha = Rotation.from_matrix(M[:, :3, :3]).as_rotvec()
    beta = Rotation.from_matrix(N[:, :3, :3]).as_rotvec()
    # Vectors near half a turn have an uncertain sign: they would poison the sum.
    keep = np.linalg.norm(alpha, axis=1) < np.deg2rad(170)
    R_Z = nearest_rotation(alpha[keep].T @ beta[keep])
    R_X = nearest_rotation(np.einsum("nij,jk,nlk->il", A[:, :3, :3], R_Z, C[:, :3, :3]))
    return _translations(A, C, R_X, R_Z)


def _translations(A: Poses, C: Poses, R_X: Rotation3, R_Z: Rotation3) -> tuple[Pose, Pose]:
    """R_A t_Z + t_A = R_X t_C + t_X, by least squares over all views."""
    n = len(A)
    rows = np.zeros((3 * n, 6))
    rows[:, :3] = A[:, :3, :3].reshape(3 * n, 3)
    rows[:, 3:] = np.tile(-np.eye(3), (n, 1))
    right = (C[:, :3, 3] @ R_X.T - A[:, :3, 3]).reshape(3 * n)
    t, *_ = np.linalg.lstsq(rows, right, rcond=None)
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3] = R_X, t[3:]
    Z[:3, :3], Z[:3, 3] = R_Z, t[:3]
    return X, Z
