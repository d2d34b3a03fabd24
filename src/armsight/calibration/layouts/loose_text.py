"""Poses that stand among other words: in log lines, ``name = value`` pairs, arrays of programs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from armsight.calibration.layouts.header import Columns
from armsight.calibration.layouts.structured import structured_tables
from armsight.calibration.layouts.table import NUMBER, PoseTable, read_text, value_of
from armsight.errors import CalibrationError

PROGRAMS = (".py", ".c", ".cc", ".cpp", ".h", ".hpp", ".cs", ".java", ".js", ".m", ".ipynb")
"""Programs in which people keep poses as an array; looked into when nothing else holds any."""
COUNTS = (6, 7, 12, 16)
LEAST = 3
_PAIR = re.compile(rf"([A-Za-z_]\w*)\s*[=:]\s*({NUMBER})(?![\w.])")
_GROUP = re.compile(r"[\[({]([^\[\](){}]*)[\])}]")
_SPLIT = re.compile(r"[,;\s]+")
_PICTURE = re.compile(r"[^\s\"',;()\[\]]+\.(?:png|jpe?g|bmp|tiff?|pgm|ppm|webp)\b", re.IGNORECASE)


def loose_tables(file: Path) -> list[PoseTable]:
    """Tables of poses among the words of a text, or in a program's arrays.

    Raises:
        CalibrationError: it cannot be read.
    """
    text = read_text(file)
    lines = text.splitlines()
    for found in (_json_lines(lines, file.name), _pairs(lines, file.name)):
        if found:
            return found
    by_line = _groups([(line, line) for line in lines], file.name)
    return by_line or _groups([(text, "")], file.name)


def _json_lines(lines: list[str], source: str) -> list[PoseTable]:
    """One JSON object a line."""
    objects: list[Any] = []
    for line in lines:
        if not line.strip():
            continue
        if not line.lstrip().startswith("{"):
            return []
        try:
            objects.append(json.loads(line))
        except (ValueError, RecursionError):
            return []
    return structured_tables(objects, source) if len(objects) >= LEAST else []


def _pairs(lines: list[str], source: str) -> list[PoseTable]:
    """``x=0.1 y=0.2 ... rz=30`` a line, whatever else stands there."""
    rows: dict[tuple[str, ...], list[tuple[str, list[float]]]] = {}
    for line in lines:
        found = _PAIR.findall(line)
        if len(found) >= 6:
            names = tuple(n for n, _ in found)
            picture = _PICTURE.search(line)
            value = [value_of(v) for _, v in found]
            rows.setdefault(names, []).append((picture.group(0) if picture else "", value))
    out = []
    for names, mine in rows.items():
        columns = Columns(list(names))
        if not columns.pose or len(mine) < LEAST:
            continue
        values = np.array([v for _, v in mine])[:, columns.pose]
        out.append(
            PoseTable(source, tuple(k for k, _ in mine), values, columns.names, columns.length,
                      columns.angle, columns.rotation)
        )  # fmt: skip
    return out


def _groups(parts: list[tuple[str, str]], source: str) -> list[PoseTable]:
    """Groups of six to sixteen numbers in brackets; the first of each line, or all of a text."""
    rows: dict[int, list[tuple[str, list[float]]]] = {}
    for text, line in parts:
        for inner in _GROUP.findall(text):
            cells = [c for c in _SPLIT.split(inner.strip()) if c]
            if len(cells) not in COUNTS or not all(re.fullmatch(NUMBER, c) for c in cells):
                continue
            picture = _PICTURE.search(line)
            name = picture.group(0) if picture else ""
            rows.setdefault(len(cells), []).append((name, [value_of(c) for c in cells]))
            if line:
                break
    return [
        PoseTable(source, tuple(k for k, _ in mine), np.array([v for _, v in mine]))
        for mine in rows.values()
        if len(mine) >= LEAST
    ]


def program_tables(files: tuple[Path, ...]) -> list[PoseTable]:
    """Poses in the arrays of programs that lie in a set's folder; what cannot be read has none."""
    out: list[PoseTable] = []
    for file in files:
        if file.suffix.lower() in PROGRAMS:
            try:
                out += loose_tables(file)
            except CalibrationError:
                continue
    return out
