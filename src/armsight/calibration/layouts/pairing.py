"""Which picture belongs to which row of a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path, PureWindowsPath

import numpy as np

from armsight.arrays import Ints
from armsight.calibration.layouts.series import Series
from armsight.calibration.layouts.table import PoseTable, ordinals, stamp_of


@dataclass(frozen=True)
class Pairing:
    """Pictures and rows that belong together.

    Attributes:
        picture, row: (n,) indices.
        words: how they were tied.
        code: of the mistake that it would be, or empty for a proper way.
        firm: the names themselves say so; otherwise the pictures may decide otherwise.
        twice: what the table has more than once with different poses, and is not used.
    """

    picture: Ints
    row: Ints
    words: str
    code: str = ""
    firm: bool = False
    twice: tuple[str, ...] = ()


def proper_pairings(series: Series, table: PoseTable, seen: Ints) -> list[Pairing]:
    """The ways to tie pictures and rows that names, numbers and order allow, best first.

    Args:
        series: the pictures.
        table: of the poses.
        seen: (s,) which pictures show the board: some tools keep the poses of those alone.
    """
    out: list[Pairing] = []
    named = _by_name(series, table)
    if len(named.picture) >= max(3, 0.6 * min(len(series.files), len(table.keys))):
        return [named]
    n, m = len(series.files), len(table.values)
    timed = _by_time(series, table)
    if len(timed.picture) >= max(3, 0.6 * min(n, m)):
        out.append(timed)
    numbered = _by_number(series, table)
    whole = len(numbered.picture) == min(n, m)
    if len(numbered.picture) >= 3 and whole:
        out.append(numbered)
    if n == m:
        order = np.arange(n)
        out.append(Pairing(order, order, "in order"))
    else:
        if m == len(seen):
            words = "in order, of the pictures that show the board"
            out.append(Pairing(seen, np.arange(m), words))
        out += _of_row_numbers(series, m)
        k = np.arange(min(n, m))
        out.append(Pairing(k, k, "in order, from the first"))
        if n > m:
            out.append(Pairing(k + n - m, k, "in order, from the last"))
        else:
            out.append(Pairing(k, k + m - n, "in order, from the last"))
    if len(numbered.picture) >= 3 and not whole:
        out.append(numbered)
    return out


def _by_name(series: Series, table: PoseTable) -> Pairing:
    paths = [PureWindowsPath(key) for key in table.keys]  # cut at either slash
    place: dict[str, list[int]] = {}
    for row, (key, path) in enumerate(zip(table.keys, paths)):
        if key and not key.isdigit():
            for word in {path.name.lower(), path.stem.lower()}:
                place.setdefault(word, []).append(row)
    named: list[tuple[str, list[int]]] = []
    for file in series.files:
        mine = place.get(file.name.lower()) or place.get(file.stem.lower(), [])
        if len(mine) > 1:  # folders tell cameras apart
            near = [_alike_folders(file, paths[r]) for r in mine]
            mine = [r for r, n in zip(mine, near) if n == max(near)]
        named.append((file.name, mine))
    return replace(_tied(table, named, "by the pictures' names"), firm=True)


def _tied(table: PoseTable, named: Sequence[tuple[str, Sequence[int]]], words: str) -> Pairing:
    """Pictures, each with its name and the rows that are called so: none where these differ."""
    pictures, rows, twice = [], [], []
    for k, (name, mine) in enumerate(named):
        if len(mine) > 1 and _differ(table, mine):
            twice.append(name)
        elif mine:
            pictures.append(k)
            rows.append(mine[0])
    return Pairing(np.array(pictures, int), np.array(rows, int), words, twice=tuple(twice))


def _alike_folders(file: Path, path: PureWindowsPath) -> int:
    """How many of a file's folders, from the innermost on, a table names likewise."""
    pairs = zip(file.parts[-2::-1], path.parts[-2::-1])
    return sum(1 for _ in takewhile(lambda p: p[0].lower() == p[1].lower(), pairs))


def _differ(table: PoseTable, rows: Sequence[int]) -> bool:
    """Whether rows of one name hold different poses."""
    numbers = table.values[rows] if table.joints is None else table.joints[rows]
    return bool(np.ptp(numbers, axis=0).max(initial=0.0) > 0.0)


LATE = 0.06
"""A pose may be so much earlier or later than the picture, or half a step of its log [s]."""


def _by_time(series: Series, table: PoseTable) -> Pairing:
    """Each picture with the pose nearest in time, where both say their times."""
    stamps = [stamp_of(f.name) for f in series.files]
    none = Pairing(np.zeros(0, int), np.zeros(0, int), "by time")
    if table.stamps is None or len(table.stamps) < 2 or any(s is None for s in stamps):
        return none
    order = np.argsort(table.stamps)
    times = table.stamps[order]
    at = np.array(stamps, float)
    k = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    k = k - (at - times[k - 1] < times[k] - at)
    near = np.abs(times[k] - at) <= max(LATE, 0.5 * float(np.median(np.diff(times))))
    pictures = np.flatnonzero(near)
    return replace(none, picture=pictures, row=order[k[near]])


def _by_number(series: Series, table: PoseTable) -> Pairing:
    named = [k for k in table.keys if k]
    numbers = ordinals(list(table.keys)) if len(named) == len(table.keys) else []
    place: dict[int, list[int]] = {}
    for row, number in enumerate(numbers):
        if number is not None:
            place.setdefault(number, []).append(row)
    mine = [(str(own), [] if own is None else place.get(own, [])) for own in series.numbers]
    return _tied(table, mine, "by number")


def _of_row_numbers(series: Series, rows: int) -> list[Pairing]:
    """Pictures are missing: the number in a picture's name is the row of its pose."""
    numbers = series.numbers
    if any(n is None for n in numbers) or len(set(numbers)) < len(numbers):
        return []
    value = np.array([int(n) for n in numbers if n is not None])
    out = []
    for base in dict.fromkeys((1, 0, int(value.min()))):
        row = value - base
        fits = (row >= 0) & (row < rows)
        if fits.all():
            words = f"the number in a picture's name is the line, counted from {base}"
            out.append(Pairing(np.arange(len(value)), row, words))
    return out


def mistaken_pairings(pairing: Pairing, pictures: int, rows: int) -> list[Pairing]:
    """Ways in which people tie pictures and poses wrongly, tried when the proper one fails."""
    out: list[Pairing] = []
    order = np.argsort(pairing.picture)
    picture, row = pairing.picture[order], pairing.row[order]

    def add(code: str, words: str, new: Ints) -> None:
        fits = (new >= 0) & (new < rows)
        if fits.sum() >= 4 and not np.array_equal(new[fits], row[fits]):
            out.append(Pairing(picture[fits], new[fits], words, code))

    for shift in (1, -1, 2, -2):
        direction = "later" if shift > 0 else "earlier"
        words = (
            f"pictures and poses are shifted: each picture fits the pose {abs(shift)} {direction}"
        )
        add("shifted", words, row + shift)
    add(
        "order",
        "the poses are in the opposite order of the pictures",
        row.max() - (row - row.min()),
    )
    n = len(row)
    ranks = np.sort(row)
    for start in (0, 1):  # names that begin with 0 or with 1
        text = np.array(sorted(range(start, n + start), key=str)) - start
        back = np.argsort(text)
        add(
            "order",
            "the pictures are sorted as text (1, 10, 11, 2), the poses as numbers",
            ranks[text],
        )
        add(
            "order",
            "the poses are sorted as text (1, 10, 11, 2), the pictures as numbers",
            ranks[back],
        )
    return out
