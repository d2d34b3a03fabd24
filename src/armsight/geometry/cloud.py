"""Point clouds: crop, thin, clean, merge; PLY files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from armsight.arrays import ColorImage, Floats, Mask, Points, Vector3
from armsight.errors import ArmsightError
from armsight.writing import write_atomically


def within_sphere(points: Points, center: Vector3, radius: float) -> Mask:
    """(n,) whether each of (n, 3) points lies within ``radius`` [m] of a centre (T2: 1500 mm)."""
    difference = np.asarray(points) - np.asarray(center)
    return np.asarray((difference**2).sum(axis=1) <= radius**2)


def within_box(points: Points, lower: Vector3, upper: Vector3) -> Mask:
    """(n,) whether each of (n, 3) points lies in an axis-aligned box, borders included."""
    p = np.asarray(points)
    return np.asarray(((p >= lower) & (p <= upper)).all(axis=1))


def voxel_centroids(points: Points, voxel: float, origin: Vector3 | None = None) -> Points:
    """One point for each voxel that holds any: the centroid of its points (T2's voxel grid).

    Args:
        points: (n, 3) [m]; those that are not finite are left out.
        voxel: edge of a voxel [m].
        origin: a corner of some voxel [m]; zero if absent.

    Returns:
        (m, 3) centroids, in the order of the voxels' indices.

    Raises:
        ValueError: the voxel is not positive.
    """
    if not voxel > 0:
        raise ValueError(f"voxel is {voxel} m; expected more than 0")
    p = np.asarray(points, float).reshape(-1, 3)
    p = p[np.isfinite(p).all(axis=1)]
    if len(p) == 0:
        return np.empty((0, 3))
    start = np.zeros(3) if origin is None else np.asarray(origin, float)
    index = np.floor((p - start) / voxel).astype(np.int64)
    index -= index.min(axis=0)
    span = index.max(axis=0) + 1
    key = (index[:, 0] * span[1] + index[:, 1]) * span[2] + index[:, 2]
    _, member, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(member, p[:, d], len(count)) for d in range(3)], axis=1)
    return np.asarray(sums / count[:, None])


def statistical_inliers(points: Points, neighbors: int = 16, ratio: float = 2.0) -> Mask:
    """(n,) which points are no outliers by their mean distance to their nearest neighbours.

    A point is an outlier if that mean exceeds the cloud's mean of it by more than ``ratio``
    standard deviations (Rusu et al. 2008, "Towards 3D point cloud based object maps").

    Args:
        points: (n, 3) finite points [m].
        neighbors: how many neighbours are looked at.
        ratio: how many standard deviations are allowed.
    """
    p = np.asarray(points, float).reshape(-1, 3)
    k = min(neighbors, len(p) - 1)
    if k < 1:
        return np.ones(len(p), bool)
    distance, _ = cKDTree(p).query(p, k + 1)
    mean = np.asarray(distance)[:, 1:].mean(axis=1)
    return np.asarray(mean <= mean.mean() + ratio * mean.std(), bool)


def merge(clouds: Sequence[Points], voxel: float | None = None) -> Points:
    """All clouds as one; with a voxel [m], one centroid a voxel."""
    joined = np.concatenate(
        [np.asarray(c, float).reshape(-1, 3) for c in clouds] or [np.empty((0, 3))]
    )
    return joined if voxel is None else voxel_centroids(joined, voxel)


def write_ply(path: Path, points: Points, colors: ColorImage | None = None) -> None:
    """Write (n, 3) points [m] and, if given, (n, 3) uint8 RGB as binary little-endian PLY.

    The file appears whole or not at all.

    Raises:
        ValueError: there are not as many colours as points.
        ArmsightError: the file cannot be written.
    """
    p = np.asarray(points, np.float32).reshape(-1, 3)
    fields: list[tuple[str, str]] = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if colors is not None:
        if np.shape(colors) != p.shape:
            raise ValueError(f"{len(p)} points but colours of shape {np.shape(colors)}")
        fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    rows = np.empty(len(p), dtype=fields)
    for d, (name, _) in enumerate(fields):
        rows[name] = p[:, d] if d < 3 else np.asarray(colors)[:, d - 3]
    kinds = {"<f4": "float", "u1": "uchar"}
    properties = [f"property {kinds[kind]} {name}" for name, kind in fields]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(p)}", *properties]
    data = ("\n".join([*header, "end_header"]) + "\n").encode() + rows.tobytes()
    write_atomically(path, data)


_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}


def read_ply(path: Path) -> tuple[Points, ColorImage | None]:
    """(n, 3) points [m] and (n, 3) uint8 RGB or None of a PLY file, text or binary.

    Raises:
        ArmsightError: the file is missing, no PLY, or cut short.
    """
    target = Path(path)
    try:
        data = target.read_bytes()
    except OSError as error:
        raise ArmsightError(f"cannot read {target}: {error.strerror}") from None
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ArmsightError(f"{target} is no PLY file: it has no header")
    lines = data[:end].decode("ascii", "replace").split("\n")
    body = data[data.find(b"\n", end) + 1 :]
    kind, count, fields = _ply_header(lines, target)
    if kind == "ascii":
        words = np.array(body.split()[: count * len(fields)], dtype=float)
        if len(words) < count * len(fields):
            raise ArmsightError(f"{target} is cut short: fewer than {count} vertices")
        table = words.reshape(count, len(fields))
        columns: dict[str, Floats] = {name: table[:, i] for i, (name, _) in enumerate(fields)}
    else:
        order = "<" if kind == "binary_little_endian" else ">"
        layout = np.dtype([(name, order + code) for name, code in fields])
        if len(body) < count * layout.itemsize:
            raise ArmsightError(f"{target} is cut short: fewer than {count} vertices")
        rows = np.frombuffer(body, layout, count)
        columns = {name: rows[name].astype(float) for name, _ in fields}
    if not {"x", "y", "z"} <= set(columns):
        raise ArmsightError(f"{target} has vertices without x, y and z")
    points = np.stack([columns[c] for c in "xyz"], axis=1)
    if not {"red", "green", "blue"} <= set(columns):
        return points, None
    colors = np.stack([columns[c] for c in ("red", "green", "blue")], axis=1)
    return points, colors.astype(np.uint8)


def _ply_header(lines: list[str], target: Path) -> tuple[str, int, list[tuple[str, str]]]:
    """Format, number of vertices and their fields; vertices must be the first element."""
    kind, count, fields, element = "", -1, [], ""
    for line in lines:
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1]
        elif words[:1] == ["element"]:
            if not element and words[1] != "vertex":
                raise ArmsightError(f"{target}: expected vertices first, found '{words[1]}'")
            element = words[1]
            if element == "vertex":
                count = int(words[2])
        elif words[:1] == ["property"] and element == "vertex":
            if words[1] not in _PLY_TYPES:
                raise ArmsightError(f"{target}: vertices have a property of type '{words[1]}'")
            fields.append((words[2], _PLY_TYPES[words[1]]))
    if kind not in ("ascii", "binary_little_endian", "binary_big_endian") or count < 0:
        raise ArmsightError(f"{target} has a PLY header that cannot be understood")
    return kind, count, fields
