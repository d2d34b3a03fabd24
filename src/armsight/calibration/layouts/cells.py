"""A line of a table cut into cells: names with spaces, numbers with decimal commas stay whole."""

from __future__ import annotations

import csv
import re

from armsight.calibration.layouts.table import NUMBER

DELIMITERS = (";", "\t", ",")
"""A line is cut by the first of these that is in it, else by white space."""
COUNTS = (6, 7, 12, 16)
"""Numbers that a pose may have."""
_IS_NUMBER = re.compile(rf"^{NUMBER}$")
_SPLIT = re.compile(r"[,;\t ]+")
_DECIMAL = re.compile(r"^[-+]?\d+,\d+(?:[eE][-+]?\d+)?$")
_PICTURE = re.compile(
    r"^(.*?\.(?:png|jpe?g|bmp|tiff?|pgm|ppm|webp|jp2))[\s:]+(?=\S)", re.IGNORECASE
)


def is_number(cell: str) -> bool:
    """Whether a cell is a number, as people and FORTRAN write it."""
    return _IS_NUMBER.match(cell) is not None


def cells_of(line: str) -> list[str]:
    """The cells of a line, empty ones within it, too."""
    delimiter = next((d for d in DELIMITERS if d in line), None)
    if delimiter is None:
        named = _PICTURE.match(line)
        return line.split() if named is None else [named.group(1), *line[named.end() :].split()]
    line = line.strip(" \r\n")
    if delimiter != "\t":
        line = line.replace("\t", " ")
    try:
        found = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        found = line.split(delimiter)
    cells = [c.strip().strip("\"'").strip() for c in found]
    # A comma in a cell of its own is a decimal one.
    return [c.replace(",", ".") if _DECIMAL.match(c) else c for c in cells]


def trimmed(cells: list[str]) -> list[str]:
    """The same without the empty ones at the end."""
    last = max((k for k, c in enumerate(cells) if c), default=-1)
    return cells[: last + 1]


def loose_cells(line: str) -> list[str]:
    """Names and numbers of a line that no header explains, whatever divides them."""
    parts = [c.strip("\"'") for c in _SPLIT.split(line.strip()) if c.strip("\"'")]
    out: list[str] = []
    for cell in cells_of(line):
        inner = cell.split()
        if all(is_number(c) for c in inner):
            out += inner
        elif _PICTURE.match(cell) or "=" in inner or all(map(is_number, inner[-2:])):
            return parts  # "im_1.png 0.1, 0.2, 0.3": a name and numbers in one cell
        else:
            out.append(cell)
    numbers = sum(map(is_number, out))
    if numbers == len(out):
        return out
    # "tcp 100, 200, ..." and "view 1, 100, 200, ...": is the first number the name's?
    unclear = not any(d in line for d in ";\t") and sum(map(is_number, parts)) in COUNTS
    return parts if unclear or numbers < min(COUNTS) else out
