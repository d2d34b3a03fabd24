"""Rigid transforms as plain 4x4 arrays named ``T_a_b`` (coordinates in b to coordinates in a)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Points, Pose, Poses, Rotation3, Vector3


def make_pose(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> Pose:
    """Pose from a (3, 3) rotation and a (3,) translation [m]; the identity for what is absent."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def from_rpy(rpy: ArrayLike, translation: ArrayLike | None = None) -> Pose:
    """Pose from roll, pitch, yaw [rad] about the fixed x, y, z axes (URDF's order)."""
    return make_pose(Rotation.from_euler("xyz", np.asarray(rpy, float)).as_matrix(), translation)


def from_quaternion(xyzw: ArrayLike, translation: ArrayLike | None = None) -> Pose:
    """Pose from a quaternion (x, y, z, w), normalised here."""
    return make_pose(Rotation.from_quat(np.asarray(xyzw, float)).as_matrix(), translation)


def to_quaternion(T: Pose) -> Floats:
    """(4,) quaternion x, y, z, w of a pose."""
    return np.asarray(Rotation.from_matrix(T[:3, :3]).as_quat(), float)


def to_wxyz(T: Pose) -> Floats:
    """(4,) quaternion w, x, y, z of a pose, the order of MuJoCo and viser."""
    return to_quaternion(T)[[3, 0, 1, 2]]


def cross(a: Vector3, b: Vector3) -> Vector3:
    """(3,) cross product of two (3,) vectors: NumPy's, for any shapes, takes ten times as long."""
    (x, y, z), (u, v, w) = a, b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def unit(v: Vector3) -> Vector3:
    """(3,) the direction of a vector; that of none is none."""
    return np.asarray(v / max(float(np.linalg.norm(v)), 1e-12), float)


def is_rotation(R: Rotation3, tolerance: float = 1e-6) -> bool:
    """Whether finite (3, 3) numbers turn, and neither stretch nor mirror."""
    return bool(np.allclose(R @ R.T, np.eye(3), atol=tolerance) and np.linalg.det(R) > 0.0)


def inverse(T: Pose) -> Pose:
    """``T_b_a`` of ``T_a_b``."""
    R = T[:3, :3].T
    return make_pose(R, -R @ T[:3, 3])


def inverses(T: Poses) -> Poses:
    """(n, 4, 4) ``T_b_a`` of each of (n, 4, 4) ``T_a_b``."""
    out = np.zeros_like(T)
    out[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    out[:, :3, 3] = -np.einsum("nij,nj->ni", out[:, :3, :3], T[:, :3, 3])
    out[:, 3, 3] = 1.0
    return out


def transform(T_a_b: Pose, points_b: Points) -> Points:
    """(n, 3) points in b to (n, 3) points in a."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def look_at(position: ArrayLike, target: ArrayLike, up: Sequence[float] = (0.0, 0.0, 1.0)) -> Pose:
    """Pose ``T_world_camera`` of an optical frame (z forward, x right, y down) looking at a point.

    Raises:
        ValueError: the position is the target, or the view is along ``up``.
    """
    eye = np.asarray(position, float)
    forward = np.asarray(target, float) - eye
    length = np.linalg.norm(forward)
    if length < 1e-9:
        raise ValueError("look_at: the camera's position and its target are the same point")
    forward = forward / length
    right = np.cross(forward, np.asarray(up, float))
    if np.linalg.norm(right) < 1e-9:
        raise ValueError("look_at: the view is along 'up'; choose another up vector")
    right = right / np.linalg.norm(right)
    return make_pose(np.column_stack([right, np.cross(forward, right), forward]), eye)


def exp(twist: ArrayLike) -> Pose:
    """SE(3) exponential of a (6,) twist (translation [m], rotation vector [rad])."""
    xi = np.asarray(twist, float)
    phi = xi[3:]
    angle = float(np.linalg.norm(phi))
    K = skew(phi)
    if angle < 1e-8:
        V = np.eye(3) + 0.5 * K
    else:
        V = (
            np.eye(3)
            + (1 - np.cos(angle)) / angle**2 * K
            + (angle - np.sin(angle)) / angle**3 * (K @ K)
        )
    return make_pose(Rotation.from_rotvec(phi).as_matrix(), V @ xi[:3])


def log(T: Pose) -> Floats:
    """(6,) twist of a pose: the inverse of :func:`exp` for rotations below pi."""
    phi = np.asarray(Rotation.from_matrix(T[:3, :3]).as_rotvec(), float)
    angle = float(np.linalg.norm(phi))
    K = skew(phi)
    if angle < 1e-8:
        V_inv = np.eye(3) - 0.5 * K
    else:
        half = 0.5 * angle
        V_inv = np.eye(3) - 0.5 * K + (1 - half / np.tan(half)) / angle**2 * (K @ K)
    return np.concatenate([V_inv @ T[:3, 3], phi])


def skew(v: Vector3) -> Rotation3:
    """(3, 3) cross-product matrix of a vector."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def skews(v: Floats) -> Floats:
    """(..., 3, 3) cross-product matrices of (..., 3) vectors."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def interpolate(T_a: Pose, T_b: Pose, fraction: float) -> Pose:
    """Pose on the screw motion from ``T_a`` (fraction 0) to ``T_b`` (fraction 1)."""
    return T_a @ exp(fraction * log(inverse(T_a) @ T_b))


def angle_between(T_a: Pose, T_b: Pose) -> float:
    """Angle of the rotation from one pose to the other [rad]."""
    return float(Rotation.from_matrix(T_a[:3, :3].T @ T_b[:3, :3]).magnitude())
