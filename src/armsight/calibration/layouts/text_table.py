"""Poses in text: CSV with or without a header, blocks of 4x4 rows, robot programs, Halcon, MATLAB.

A line is data when it consists of numbers, but for a picture's name or a label before them. Rows of
four (or three) that follow each other are matrices; one number a line, or all on one, is cut by the
count of pictures.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.table import PoseTable, read_text
from armsight.errors import CalibrationError

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
_IS_NUMBER = re.compile(rf"^{_NUMBER}$")
_SPLIT = re.compile(r"[,;\t ]+")
_COMMENT = re.compile(r"^\s*(#|%|//|!|'|\*)")


@dataclass(frozen=True)
class Row:
    """A line of data: its number in the file, what stood before the numbers, the numbers."""

    line: int
    label: str
    cells: tuple[str, ...]


def text_tables(file: Path, pictures: int) -> list[PoseTable]:
    """Every table of poses that a text file may hold; none when it holds no numbers.

    Args:
        file: the file.
        pictures: how many pictures there are, to cut long rows.

    Raises:
        CalibrationError: it cannot be read, or it is a table of poses with lines that are none.
    """
    text = read_text(file)
    for program in (_kuka, _rapid, _urscript, _halcon):
        table = program(text, file.name)
        if table is not None:
            return [table]
    rows, header, odd = _rows(text)
    if not rows:
        return []
    if header is not None:
        named = _with_header(rows, header, file.name)
        if named is not None:
            _refuse_half(file, rows, odd, len(rows[0].cells))
            return [named]
    return _plain(file, rows, odd, pictures)


def numbers_of(file: Path) -> PoseTable | None:
    """One pose from a file of its own: all its numbers in a row; None when it holds none."""
    text = read_text(file)
    for program in (_halcon, _kuka, _rapid, _urscript):
        table = program(text, file.name)
        if table is not None and len(table.values) == 1:
            return table
    rows, header, _ = _rows(text)
    if header is not None and len(rows) == 1:
        named = _with_header(rows, header, file.name)
        if named is not None:
            return named
    pairs = _labelled(text)
    if pairs is not None:
        columns = Columns(list(pairs))
        if columns.pose:
            value = np.array([list(pairs.values())])[:, columns.pose]
            return PoseTable(
                file.name, ("",), value, columns.names, columns.length, columns.angle,
                columns.rotation,
            )  # fmt: skip
    flat = [_value(c) for row in rows for c in row.cells]
    if len(flat) not in (6, 7, 12, 16):
        return None
    return PoseTable(file.name, ("",), np.array([flat]), decimals=_decimals(rows))


def _labelled(text: str) -> dict[str, float] | None:
    """``x: 0.1`` or ``x = 0.1`` a line."""
    found = re.findall(rf"^\s*([A-Za-z_]+)\s*[:=]\s*({_NUMBER})\s*;?\s*$", text, re.MULTILINE)
    return {name: _value(v) for name, v in found} if len(found) >= 6 else None


def _value(cell: str) -> float:
    return float(cell.replace("d", "e").replace("D", "e"))


def _rows(text: str) -> tuple[list[Row], list[str] | None, list[tuple[int, str]]]:
    """Lines of data, the header right before the first of them, and lines that are neither."""
    rows: list[Row] = []
    header: list[str] | None = None
    odd: list[tuple[int, str]] = []
    last: str | None = None
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or _COMMENT.match(line):
            # A header is often a comment: "# x y z qx qy qz qw".
            if line and not rows:
                last = line.lstrip("#%/!'* ")
            continue
        row = _row(number, line)
        if row is None:
            if not rows:
                last = line
            odd.append((number, line))
            continue
        if not rows and last is not None:
            cells = _cells(last)
            if len(cells) == len(_cells(line)) and not any(_IS_NUMBER.match(c) for c in cells):
                header = cells
                odd = [o for o in odd if o[1] != last]
        rows.append(row)
    return rows, header, odd


def _cells(line: str) -> list[str]:
    for delimiter in (";", ",", "\t"):
        if delimiter in line:
            return [c.strip().strip("\"'") for c in line.rstrip(delimiter + " ").split(delimiter)]
    return line.split()


def _row(number: int, line: str) -> Row | None:
    if ";" in line and re.search(r"\d,\d", line) and "." not in line:
        line = line.replace(",", ".")  # decimal commas
    line = line.replace("...", " ")  # MATLAB goes on in the next line
    line = re.sub(r"[\[\](){}]", " ", line)
    line = re.sub(r"^\s*[A-Za-z_]\w*(\(\s*:?[^=]*\))?\s*=", " ", line)  # name =
    cells = [c.strip("\"'") for c in _SPLIT.split(line.strip()) if c.strip("\"'")]
    label = ""
    if cells and not _IS_NUMBER.match(cells[0]):
        label, cells = cells[0].rstrip(":"), cells[1:]
    if not cells or not all(_IS_NUMBER.match(c) for c in cells):
        return None
    return Row(number, label, tuple(cells))


def _with_header(rows: list[Row], header: list[str], source: str) -> PoseTable | None:
    columns = Columns(header)
    if not columns.pose and len(columns.joints) < 5:
        return None
    cells = [([r.label] if r.label else []) + list(r.cells) for r in rows]
    width = len(header)
    kept = [c for c in cells if len(c) == width]
    if not kept:
        return None
    keys = tuple(c[columns.key] if columns.key is not None else "" for c in kept)

    def values(at: list[int]) -> Floats:
        return np.array([[_value(c[k]) for k in at] for c in kept]).reshape(len(kept), len(at))

    try:
        pose = values(columns.pose)
        joints = values(columns.joints) * columns.joint_unit if columns.joints else None
    except ValueError:
        return None
    turns = [c[k] for c in kept for k in columns.pose[3:]]
    return PoseTable(
        source, keys, pose, columns.names, columns.length, columns.angle, columns.rotation, joints,
        _places(turns),
    )  # fmt: skip


def _plain(
    file: Path, rows: list[Row], odd: list[tuple[int, str]], pictures: int
) -> list[PoseTable]:
    widths = [len(r.cells) for r in rows]
    usual = max(set(widths), key=widths.count)
    matrix = _matrix_blocks(rows, file.name)
    if matrix is not None:
        return [matrix]
    if usual >= 6:
        _refuse_half(file, rows, odd, usual)
        kept = [r for r in rows if len(r.cells) == usual]
        value = np.array([[_value(c) for c in r.cells] for r in kept])
        keys = tuple(r.label for r in kept)
        tables = [PoseTable(file.name, keys, value, decimals=_decimals(kept))]
        first = value[:, 0]
        steps = np.diff(first)
        if not any(keys) and usual > 6 and np.all(first == np.rint(first)) and np.all(steps > 0):
            index = tuple(str(int(v)) for v in first)
            tables.insert(0, PoseTable(file.name, index, value[:, 1:], decimals=_decimals(kept)))
        return tables
    # Long rows, or one number a line: cut by the count of pictures.
    flat = np.array([_value(c) for r in rows for c in r.cells])
    out = []
    for count in (16, 12, 7, 6):
        if len(flat) == count * pictures:
            out.append(PoseTable(file.name, ("",) * pictures, flat.reshape(pictures, count)))
    return out


def _matrix_blocks(rows: list[Row], source: str) -> PoseTable | None:
    """Poses as four (or three) rows of four numbers."""
    four = [r for r in rows if len(r.cells) == 4 and not r.label]
    if len(four) < 3 or len(four) < 0.8 * len(rows):
        return None
    value = np.array([[_value(c) for c in r.cells] for r in four])
    # The rows of a matrix follow each other; between two there may be a label of one number.
    last = [0.0, 0.0, 0.0, 1.0]
    whole = len(value) % 4 == 0
    by_rows = whole and np.allclose(value[3::4], last, atol=1e-6)
    by_columns = whole and np.allclose(value[:, 3].reshape(-1, 4), last, atol=1e-6)
    if by_rows or by_columns:
        blocks = value.reshape(-1, 16)
    elif len(value) % 3 == 0:
        blocks = value.reshape(-1, 12)
    else:
        return None
    turns = [c for r in four for c in r.cells[:3]]
    return PoseTable(source, ("",) * len(blocks), blocks, decimals=_places(turns))


def _refuse_half(file: Path, rows: list[Row], odd: list[tuple[int, str]], width: int) -> None:
    """A table of poses in which some lines are none is a mistake of its owner's, named."""
    if width < 6:
        return
    first, last = rows[0].line, rows[-1].line
    bad = [(n, line) for n, line in odd if first < n and re.search(r"\w", line)]
    usual = [len(r.cells) for r in rows]
    most = max(set(usual), key=usual.count)
    bad += [(r.line, " ".join(r.cells)) for r in rows if len(r.cells) != most]
    bad = [b for b in bad if b[0] <= last or len(rows) > 2]
    if bad:
        number, line = min(bad)
        raise CalibrationError(
            f"{file}, line {number}: cannot be read as a pose like the {len(rows)} others "
            f"({most} numbers): {line[:60]!r}"
        )


def _decimals(rows: list[Row]) -> int:
    return _places([c for r in rows for c in r.cells])


def _places(cells: list[str]) -> int:
    """Most digits after the point; an exponent counts as many."""
    most = 0
    for c in cells:
        if "e" in c.lower():
            return 99
        most = max(most, len(c.partition(".")[2]))
    return most


def _kuka(text: str, source: str) -> PoseTable | None:
    """KUKA's frames: ``{X 1.0, Y 2.0, Z 3.0, A 10.0, B 20.0, C 30.0, ...}`` (mm, degrees)."""
    pattern = r"\{[^{}]*?" + r"[^{}]*?".join(rf"\b{a}\s+({_NUMBER})" for a in "XYZABC")
    found = re.findall(pattern, text)
    if not found:
        return None
    value = np.array([[_value(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(
        source, ("",) * len(value), value, names, 1e-3, np.pi / 180, "ZYX",
        decimals=_places([c for row in found for c in row[3:]]),
    )  # fmt: skip


def _rapid(text: str, source: str) -> PoseTable | None:
    """ABB's robtargets: ``[[x, y, z], [q1, q2, q3, q4], ...`` (mm, w x y z)."""
    number = rf"\s*({_NUMBER})\s*"
    pattern = rf"\[\s*\[{','.join([number] * 3)}\]\s*,\s*\[{','.join([number] * 4)}\]"
    if not re.search(r"robtarget|pose\b", text, re.IGNORECASE):
        return None
    found = re.findall(pattern, text)
    if not found:
        return None
    value = np.array([[_value(c) for c in row] for row in found])[:, [0, 1, 2, 4, 5, 6, 3]]
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return PoseTable(source, ("",) * len(value), value, names, 1e-3)


def _urscript(text: str, source: str) -> PoseTable | None:
    """Universal Robots' poses: ``p[x, y, z, rx, ry, rz]`` (m, rotation vector)."""
    number = rf"\s*({_NUMBER})\s*"
    found = re.findall(rf"\bp\[{','.join([number] * 6)}\]", text)
    if not found:
        return None
    value = np.array([[_value(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(source, ("",) * len(value), value, names, 1.0, 1.0, "vector")


_HALCON = {0: "XYZ", 2: "ZYX", 4: "vector"}
"""Halcon's representation types 'gba', 'abg' and 'rodriguez', all 'Rp+T' of points."""


def _halcon(text: str, source: str) -> PoseTable | None:
    """Halcon's pose files: lines ``f TYPE``, ``r A B C`` (degrees), ``t X Y Z`` (m)."""
    found = {
        letter: re.findall(rf"^{letter}((?:\s+{_NUMBER})+)\s*$", text, re.MULTILINE)
        for letter in "frt"
    }
    if not all(len(found[letter]) == 1 for letter in "frt"):
        return None
    kind = int(_value(found["f"][0].split()[0]))
    r = [_value(c) for c in found["r"][0].split()]
    t = [_value(c) for c in found["t"][0].split()]
    if len(r) != 3 or len(t) != 3 or kind not in _HALCON:
        return None
    if kind == 2:  # 'abg' writes its angles about x, y, z, and turns about z first
        r = r[::-1]
    names = ("x", "y", "z", "rx", "ry", "rz")
    unit = 1.0 if kind == 4 else np.pi / 180
    return PoseTable(source, ("",), np.array([t + r]), names, 1.0, unit, _HALCON[kind])
