"""Which picture belongs to which row of a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

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
    """

    picture: Ints
    row: Ints
    words: str
    code: str = ""
    firm: bool = False


def proper_pairings(series: Series, table: PoseTable, seen: Ints) -> list[Pairing]:
    """The ways to tie pictures and rows that names, numbers and order allow, best first.

    Args:
        series: the pictures.
        table: of the poses.
        seen: (s,) which pictures show the board: some tools keep the poses of those alone.
    """
    out: list[Pairing] = []
    named = _by_name(series, table.keys)
    if len(named.picture) >= max(3, 0.6 * min(len(series.files), len(table.keys))):
        return [named]
    n, m = len(series.files), len(table.values)
    timed = _by_time(series, table)
    if len(timed.picture) >= max(3, 0.6 * min(n, m)):
        out.append(timed)
    numbered = _by_number(series, table.keys)
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


def _by_name(series: Series, keys: tuple[str, ...]) -> Pairing:
    place: dict[str, int] = {}
    for row, key in enumerate(keys):
        if key and not key.isdigit():
            place.setdefault(Path(key).name.lower(), row)
            place.setdefault(Path(key).stem.lower(), row)
    pictures, rows = [], []
    for k, file in enumerate(series.files):
        found = place.get(file.name.lower(), place.get(file.stem.lower()))
        if found is not None:
            pictures.append(k)
            rows.append(found)
    return Pairing(np.array(pictures, int), np.array(rows, int), "by the pictures' names", "", True)


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


def _by_number(series: Series, keys: tuple[str, ...]) -> Pairing:
    named = [k for k in keys if k]
    numbers = ordinals(list(keys)) if len(named) == len(keys) else []
    place: dict[int, int] = {}
    for row, number in enumerate(numbers):
        if number is not None:
            place.setdefault(number, row)
    pictures, rows = [], []
    for k, own in enumerate(series.numbers):
        if own is not None and own in place:
            pictures.append(k)
            rows.append(place[own])
    return Pairing(np.array(pictures, int), np.array(rows, int), "by number")


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
