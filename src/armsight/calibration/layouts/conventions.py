"""What numbers of a pose can mean: every usual way to write a rotation, as readings of a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses
from armsight.calibration.layouts.table import PoseTable

EULER: dict[str, str] = {
    "xyz": "roll, pitch, yaw about fixed x, y, z (ROS, Fanuc W P R, Denso)",
    "ZYX": "angles about moving z, y, x in this order (KUKA A B C)",
    "XYZ": "angles about moving x, y, z (Halcon, Staubli)",
    "zyx": "angles about fixed z, y, x",
    "ZYZ": "angles about moving z, y, z (Kawasaki O A T)",
    "ZXZ": "angles about moving z, x, z",
    "XYX": "angles about moving x, y, x",
    "XZX": "angles about moving x, z, x",
    "YXY": "angles about moving y, x, y",
    "YZY": "angles about moving y, z, y",
    "XZY": "angles about moving x, z, y",
    "YXZ": "angles about moving y, x, z",
    "YZX": "angles about moving y, z, x",
    "ZXY": "angles about moving z, x, y",
    "xzy": "angles about fixed x, z, y",
    "yxz": "angles about fixed y, x, z",
    "yzx": "angles about fixed y, z, x",
    "zxy": "angles about fixed z, x, y",
}
"""Euler conventions in the order of how usual they are; scipy's letters (capitals: moving axes)."""

VECTOR = "rotation vectors, axis times angle (UR, theta-u)"


@dataclass(frozen=True)
class Reading:
    """One meaning of a table's numbers.

    Attributes:
        table: where they stand.
        words: the meaning, for people.
        kind: ``quaternion xyzw``, ``matrix rows``, ``vector``, ``ZYX`` ...: stable, for programs.
        degrees: angles are in degrees.
        declared: the file says so itself.
        rank: how unusual it is; the more usual one wins a tie.
        position: (n, 3) as written.
        R: (n, 3, 3) rotations.
    """

    table: PoseTable
    words: str
    kind: str
    degrees: bool
    declared: bool
    rank: int
    position: Floats
    R: Floats

    def poses(self, length: float = 1.0) -> Poses:
        """(n, 4, 4) with positions times ``length``."""
        T = np.zeros((len(self.R), 4, 4))
        T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = self.R, self.position * length, 1.0
        return T


def readings(table: PoseTable) -> list[Reading]:
    """Every meaning that a table's numbers can have, the declared one first."""
    found = [r for r in _all(table) if np.isfinite(r.R).all() and np.isfinite(r.position).all()]
    found.sort(key=lambda r: (not r.declared, r.rank))
    return found


def _all(table: PoseTable) -> Iterator[Reading]:
    if table.names is not None:
        yield from _named(table)
        return
    m = table.values.shape[1]
    for count, reader in ((16, _matrices), (12, _matrices), (7, _seven), (6, _six)):
        if m < count:
            continue
        # More columns than a pose has: an index, a stamp or joints before or behind it.
        starts = sorted(range(m - count + 1), key=lambda s: (s != m - count, s))
        found = False
        for rank, start in enumerate(starts):
            for reading in reader(table, table.values[:, start : start + count], 30 * rank):
                found = True
                yield reading
        if found and count != 6:
            return


def _named(table: PoseTable) -> Iterator[Reading]:
    names = {name: k for k, name in enumerate(table.names or ())}
    value = table.values

    def take(*wanted: str) -> Floats:
        return value[:, [names[w] for w in wanted]]

    if {"m0", "m11"} <= set(names):
        count = 16 if "m15" in names else 12
        yield from _matrices(table, take(*(f"m{k}" for k in range(count))), 0)
        return
    if not {"x", "y", "z"} <= set(names):
        return
    position = take("x", "y", "z")
    if {"qx", "qy", "qz", "qw"} <= set(names):
        first = "x" if names["qx"] < names["qw"] else "w"
        axes = ("qx", "qy", "qz")
        q = take(*axes, "qw") if first == "x" else take("qw", *axes)
        yield from _quaternions(table, position, q, 0, first)
    elif {"rx", "ry", "rz"} <= set(names):
        yield from _three(table, position, take("rx", "ry", "rz"), 0)
    elif {"r00", "r22"} <= set(names):
        block = take(*(f"r{i}{j}" for i in range(3) for j in range(3)))
        yield from _rotations(table, position, block, 0, "")


def _matrices(table: PoseTable, value: Floats, rank: int) -> Iterator[Reading]:
    n, m = value.shape
    if m == 16:
        rows = value.reshape(n, 4, 4)
        last = np.array([0.0, 0.0, 0.0, 1.0])
        if np.allclose(rows[:, 3], last, atol=1e-6):
            yield from _rotations(table, rows[:, :3, 3], rows[:, :3, :3].reshape(n, 9), rank, "")
        elif np.allclose(rows[:, :, 3], last, atol=1e-6):
            turned = np.swapaxes(rows, 1, 2)
            yield from _rotations(
                table, turned[:, :3, 3], turned[:, :3, :3].reshape(n, 9), rank, "4x4, by columns, "
            )
        return
    rows = value.reshape(n, 3, 4)
    yield from _rotations(table, rows[:, :, 3], rows[:, :, :3].reshape(n, 9), rank, "3x4, ")
    yield from _rotations(table, value[:, 9:], value[:, :9], rank + 2, "rotation then position, ")
    yield from _rotations(table, value[:, :3], value[:, 3:], rank + 4, "position then rotation, ")
    columns = np.swapaxes(value.reshape(n, 4, 3), 1, 2)
    yield from _rotations(
        table, columns[:, :, 3], columns[:, :, :3].reshape(n, 9), rank + 6, "3x4 by columns, "
    )


def _rotations(
    table: PoseTable, position: Floats, block: Floats, rank: int, words: str
) -> Iterator[Reading]:
    R = block.reshape(-1, 3, 3)
    # Rounded to three digits at least; a left-handed one is a mirror and no rotation.
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0.0) > 0.05:
        return
    if np.linalg.det(R).min(initial=1.0) < 0:
        return
    R = _nearest(R)
    yield Reading(table, words + "matrices", "matrix", False, rank == 0, rank, position, R)
    turned = np.swapaxes(R, 1, 2)
    yield Reading(
        table,
        words + "matrices, rotations transposed (written by columns)",
        "matrix transposed",
        False,
        False,
        rank + 1,
        position,
        turned,
    )


def _nearest(R: Floats) -> Floats:
    U, _, V_t = np.linalg.svd(R)
    return np.asarray(U @ V_t, np.float64)


def _seven(table: PoseTable, value: Floats, rank: int) -> Iterator[Reading]:
    yield from _quaternions(table, value[:, :3], value[:, 3:], rank)
    yield from _quaternions(table, value[:, 4:], value[:, :4], rank + 4)


def _quaternions(
    table: PoseTable, position: Floats, q: Floats, rank: int, named: str = ""
) -> Iterator[Reading]:
    """Quaternions of either order; ``named``: the first of the four by the columns' names."""
    norm = np.linalg.norm(q, axis=1)
    if np.any(np.abs(norm - 1.0) > 0.05):
        return
    for k, (order, columns) in enumerate((("x y z w", [0, 1, 2, 3]), ("w x y z", [1, 2, 3, 0]))):
        yield Reading(
            table,
            f"quaternions {order}",
            f"quaternion {order.replace(' ', '')}",
            False,
            named == order[0],
            rank + k,
            position,
            Rotation.from_quat(q[:, columns]).as_matrix(),
        )


def _six(table: PoseTable, value: Floats, rank: int) -> Iterator[Reading]:
    yield from _three(table, value[:, :3], value[:, 3:], rank)
    yield from _three(table, value[:, 3:], value[:, :3], rank + 25)


def _three(table: PoseTable, position: Floats, r: Floats, rank: int) -> Iterator[Reading]:
    """Three numbers a rotation: a vector or angles, in radians or degrees."""
    largest = float(np.abs(r).max(initial=0.0))
    for degrees in (False, True):
        factor = np.pi / 180 if degrees else 1.0
        # The file names its unit: the other one is a mistake that may be found out.
        other = table.angle is not None and not np.isclose(table.angle, factor)
        penalty = 60 if other else 0
        if not degrees and largest > 2 * np.pi + 1e-6 and table.angle is None:
            continue  # no angle is larger than a turn, and people do not write radians so
        unit = ", degrees" if degrees else ", radians"
        said = table.rotation is not None and penalty == 0
        for k, (kind, words) in enumerate((("vector", VECTOR), *EULER.items())):
            if kind == "vector":
                R = Rotation.from_rotvec(r * factor).as_matrix()
            else:
                R = Rotation.from_euler(kind, r * factor).as_matrix()
            yield Reading(
                table,
                words + unit,
                kind,
                degrees,
                said and kind == table.rotation,
                rank + k + penalty,
                position,
                R,
            )
