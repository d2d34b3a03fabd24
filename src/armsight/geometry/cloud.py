"""Point clouds in PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armsight.arrays import ColorImage, Floats, Points
from armsight.errors import ArmsightError
from armsight.writing import write_atomically


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
        ArmsightError: the file is missing, no PLY, broken, or cut short.
    """
    try:
        return _read_ply(Path(path))
    except (ValueError, IndexError) as error:
        raise ArmsightError(f"{path} is a broken PLY file: {error}") from None


def _read_ply(target: Path) -> tuple[Points, ColorImage | None]:
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
