"""Poses in text: CSV with or without a header, blocks of 4x4 rows, robot programs, Halcon, MATLAB.

A line is data when it consists of numbers, but for a picture's name or a label before them. Rows of
four (or three) that follow each other are matrices; one number a line, or all on one, is cut by the
count of pictures.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.layouts.cells import cells_of, is_number, loose_cells, trimmed
from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.robot_programs import PROGRAMS
from armsight.calibration.layouts.table import (
    NUMBER,
    PoseTable,
    places,
    read_text,
    seconds,
    value_of,
)
from armsight.errors import CalibrationError

_COMMENT = re.compile(r"^\s*(#|%|//|!|'|\*)")


@dataclass(frozen=True)
class Row:
    """A line of data: its number in the file, its word, the numbers; all as it stands there."""

    line: int
    label: str
    cells: tuple[str, ...]
    whole: tuple[str, ...] = ()


def text_tables(file: Path, pictures: int) -> list[PoseTable]:
    """Every table of poses that a text file may hold; none when it holds no numbers.

    Args:
        file: the file.
        pictures: how many pictures there are, to cut long rows.

    Raises:
        CalibrationError: it cannot be read, or it is a table of poses with lines that are none.
    """
    text = read_text(file)
    for program in PROGRAMS:
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
    for program in PROGRAMS:
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
    flat = [value_of(c) for row in rows for c in row.cells]
    if len(flat) not in (6, 7, 12, 16):
        return None
    return PoseTable(file.name, ("",), np.array([flat]), decimals=_decimals(rows))


def _labelled(text: str) -> dict[str, float] | None:
    """``x: 0.1`` or ``x = 0.1`` a line."""
    found = re.findall(rf"^\s*([A-Za-z_]+)\s*[:=]\s*({NUMBER})\s*;?\s*$", text, re.MULTILINE)
    return {name: value_of(v) for name, v in found} if len(found) >= 6 else None


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
        row = _by_header(number, raw, last)
        if row is not None and header is None:
            header = _titles(last)
            odd = [o for o in odd if o[1] != last]
        row = row or _row(number, line)
        if row is None:
            if not rows:
                last = line
            odd.append((number, line))
            continue
        if not rows and header is None:
            titles = _titles(last)
            if titles and len(titles) == len(trimmed(cells_of(line))):
                header = titles
                odd = [o for o in odd if o[1] != last]
        rows.append(row)
    return rows, header, odd


@lru_cache(maxsize=4)
def _titles(line: str | None) -> list[str]:
    """The cells of a line that may be a header: words only; none for another line."""
    cells = trimmed(cells_of(line)) if line is not None else []
    return [] if any(map(is_number, cells)) else cells


@lru_cache(maxsize=4)
def _columns(line: str | None) -> Columns:
    return Columns(_titles(line))


def _by_header(number: int, raw: str, header: str | None) -> Row | None:
    """A line of which a header says what its cells are: others may be words, or empty."""
    names, columns = _titles(header), _columns(header)
    wanted = columns.pose + columns.joints
    if len(wanted) < 5:
        return None
    cells = trimmed(cells_of(raw))
    cells += [""] * (len(names) - len(cells))
    if len(cells) != len(names) or not all(is_number(cells[k]) for k in wanted):
        return None
    label = cells[columns.key] if columns.key is not None else ""
    return Row(number, label, tuple(cells[k] for k in wanted), tuple(cells))


def _row(number: int, line: str) -> Row | None:
    line = line.replace("...", " ")  # MATLAB goes on in the next line
    line = re.sub(r"[\[\](){}]", " ", line)
    line = re.sub(r"^\s*[A-Za-z_]\w*(\(\s*:?[^=]*\))?\s*=", " ", line)  # name =
    named = re.match(r"^\s*([A-Za-z_][\w .#-]*?)\s*[:=]\s+(?=[-+.\d])", line)
    cells = loose_cells(line)
    label = ""
    if named:  # "pose 1: 0.1 0.2 ..."
        label = named.group(1)
        cells = loose_cells(line[named.end() :])
    elif cells and not is_number(cells[0]):
        label, cells = cells[0].rstrip(":"), cells[1:]
    whole = ([label] if label else []) + cells
    words = [k for k, c in enumerate(cells) if not is_number(c)]
    if len(words) == 1 and not label and len(cells) > 6:  # "17.5;im_3.png;0.1;0.2 ..."
        label = cells.pop(words[0])
    if not cells or not all(is_number(c) for c in cells):
        return None
    return Row(number, label, tuple(cells), tuple(whole))


def _with_header(rows: list[Row], header: list[str], source: str) -> PoseTable | None:
    columns = Columns(header)
    if not columns.pose and len(columns.joints) < 5:
        return None
    cells = [r.whole for r in rows]
    width = len(header)
    kept = [c for c in cells if len(c) == width]
    if not kept:
        return None
    keys = tuple(c[columns.key] if columns.key is not None else "" for c in kept)

    def values(at: list[int]) -> Floats:
        return np.array([[value_of(c[k]) for k in at] for c in kept]).reshape(len(kept), len(at))

    try:
        pose = values(columns.pose)
        joints = values(columns.joints) * columns.joint_unit if columns.joints else None
    except ValueError:
        return None
    turns = [c[k] for c in kept for k in columns.pose[3:]]
    stamps = None
    if columns.stamp is not None:
        times = [c[columns.stamp] for c in kept]
        if all(map(is_number, times)):
            stamps = seconds(np.array([value_of(c) for c in times]))
    return PoseTable(
        source, keys, pose, columns.names, columns.length, columns.angle, columns.rotation, joints,
        places(turns), stamps,
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
        value = np.array([[value_of(c) for c in r.cells] for r in kept])
        keys = tuple(r.label for r in kept)
        first = value[:, 0]
        steps = np.diff(first)
        timed = usual > 6 and np.all(steps > 0) and first[0] > 1e8
        stamps = seconds(first) if timed else None
        tables = [PoseTable(file.name, keys, value, decimals=_decimals(kept), stamps=stamps)]
        if not any(keys) and usual > 6 and np.all(first == np.rint(first)) and np.all(steps > 0):
            index = tuple(str(int(v)) for v in first)
            tables.insert(0, PoseTable(file.name, index, value[:, 1:], decimals=_decimals(kept)))
        return tables
    # Long rows, or one number a line: cut by the count of pictures.
    flat = np.array([value_of(c) for r in rows for c in r.cells])
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
    value = np.array([[value_of(c) for c in r.cells] for r in four])
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
    return PoseTable(source, ("",) * len(blocks), blocks, decimals=places(turns))


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
    return places([c for r in rows for c in r.cells])
