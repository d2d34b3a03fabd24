"""Poses as people write them, and what else the same numbers could mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses


@dataclass(frozen=True)
class RawPoses:
    """Poses as they stood in the file, so that other readings can be tried.

    Attributes:
        position: (n, 3) as written.
        rotation: (n, 4) quaternions, (n, 3) vectors or angles, or (n, 9) matrices, as written.
        kind: ``quaternion`` (x y z w), ``vector`` (axis times angle), ``rpy`` or ``matrix``.
    """

    position: Floats
    rotation: Floats
    kind: str

    def poses(self) -> Poses:
        """(n, 4, 4) read as documented: metres, radians, x y z w."""
        return stack_poses(self.position, rotations(self.kind, self.rotation))


def rotations(kind: str, r: Floats) -> Floats:
    """(n, 3, 3) rotation matrices of rotations as written; ValueError for an unknown kind."""
    if kind == "quaternion":
        return Rotation.from_quat(r).as_matrix()
    if kind == "vector":
        return Rotation.from_rotvec(r).as_matrix()
    if kind == "rpy":
        return Rotation.from_euler("xyz", r).as_matrix()
    if kind == "matrix":
        return r.reshape(-1, 3, 3)
    raise ValueError(f"unknown rotation kind {kind!r}")


def stack_poses(position: Floats, R: Floats) -> Poses:
    """(n, 4, 4) poses of (n, 3) positions and (n, 3, 3) rotations."""
    T = np.zeros((len(position), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, position, 1.0
    return T


def other_rotations(raw: RawPoses) -> list[tuple[str, str, str, Poses]]:
    """Other readings of the rotations: (code, what it would mean, what to do, poses)."""
    r, out = raw.rotation, []

    def add(code: str, words: str, cure: str, R: Floats) -> None:
        out.append((code, words, cure, stack_poses(raw.position, R)))

    if raw.kind == "quaternion":
        add(
            "quaternion_order",
            "the quaternions are w x y z, not x y z w",
            "reorder the columns, or name them qw qx qy qz",
            rotations("quaternion", r[:, [1, 2, 3, 0]]),
        )
    if raw.kind in ("vector", "rpy"):
        other = "rpy" if raw.kind == "vector" else "vector"
        name = {"rpy": "roll, pitch, yaw", "vector": "rotation vectors"}
        add(
            "degrees",
            "the angles are in degrees, not radians",
            "write radians, or name the columns with _deg",
            rotations(raw.kind, np.deg2rad(r)),
        )
        add(
            "rotation_format",
            f"the angles are {name[other]}, not {name[raw.kind]}",
            "name the columns by what they are",
            rotations(other, r),
        )
        add(
            "rotation_format",
            f"the angles are {name[other]} in degrees, not {name[raw.kind]}",
            "name the columns by what they are",
            rotations(other, np.deg2rad(r)),
        )
        add(
            "rotation_format",
            "the angles are turned about the moving z, y, x axes in that order",
            "write quaternions instead",
            Rotation.from_euler("ZYX", r).as_matrix(),
        )
    if raw.kind == "matrix":
        add(
            "matrix_order",
            "the rotation matrices are written column by column",
            "write them row by row",
            np.swapaxes(r.reshape(-1, 3, 3), 1, 2),
        )
    return out
