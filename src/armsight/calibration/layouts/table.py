"""Rows of numbers that may be poses, as a file gives them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, Ints
from armsight.errors import CalibrationError

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
"""A number as people and FORTRAN write it."""
LARGEST = 32 * 1024 * 1024
"""Bytes beyond which a text file is no list of poses."""


@dataclass(frozen=True)
class PoseTable:
    """Numbers that may be poses.

    Attributes:
        source: file or folder, for messages.
        keys: (n,) what each row belongs to: a picture's name or number; empty where order alone
            ties them.
        values: (n, m) as written.
        names: (m,) what the file calls its columns, in our words (``x``, ``qw``, ``rx`` ...), or
            None where it does not say.
        length: metres in a unit of length, where the file says so; angle: radians likewise.
        rotation: the convention that the file's format prescribes (a key of
            :data:`armsight.calibration.layouts.conventions.EULER`, or ``vector``), or None.
        joints: (n, j) joint angles [rad], or None.
        decimals: digits after the point of the coarsest rotation number; 99 where unknown.
        stamps: (n,) time of each row [s], or None.
    """

    source: str
    keys: tuple[str, ...]
    values: Floats
    names: tuple[str, ...] | None = None
    length: float | None = None
    angle: float | None = None
    rotation: str | None = None
    joints: Floats | None = None
    decimals: int = 99
    stamps: Floats | None = None

    def rows(self, index: Ints) -> PoseTable:
        """The same with some rows only."""
        return PoseTable(
            self.source,
            tuple(self.keys[int(i)] for i in index),
            self.values[index],
            self.names,
            self.length,
            self.angle,
            self.rotation,
            None if self.joints is None else self.joints[index],
            self.decimals,
            None if self.stamps is None else self.stamps[index],
        )


def read_text(file: Path) -> str:
    """A text file in any usual encoding.

    Raises:
        CalibrationError: it cannot be read, is too large, or is no text.
    """
    try:
        if file.stat().st_size > LARGEST:
            raise CalibrationError(f"{file}: is larger than {LARGEST >> 20} MiB, no list of poses")
        data = file.read_bytes()
    except OSError as error:
        raise CalibrationError(f"{file}: cannot be read: {error.strerror or error}") from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\0" in text:
        raise CalibrationError(f"{file}: is no text")
    return text


def natural(path: Path) -> list[tuple[int, int, str]]:
    """Sort key by which ``2`` comes before ``10``."""
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(t), "") if t.isdigit() else (1, 0, t.lower()) for t in parts]


def ordinals(names: list[str]) -> list[int | None]:
    """The number of each name that tells them apart: the digits that vary most between them."""
    digits = [[int(d) for d in re.findall(r"\d+", Path(n).stem)] for n in names]
    width = min((len(d) for d in digits), default=0)
    if not width:
        return [d[-1] if d else None for d in digits]
    # Count from the right: prefixes differ in length more often than endings.
    distinct = [len({d[-1 - k] for d in digits}) for k in range(width)]
    best = max(range(width), key=lambda k: (distinct[k], -k))
    return [d[-1 - best] for d in digits]


def value_of(cell: str) -> float:
    """A number from its text, FORTRAN's exponents included."""
    return float(cell.replace("d", "e").replace("D", "e"))


def places(cells: Sequence[str]) -> int:
    """Most digits after the point; an exponent counts as many."""
    most = 0
    for c in cells:
        if "e" in c.lower():
            return 99
        most = max(most, len(c.partition(".")[2]))
    return most


def seconds(stamps: Floats) -> Floats:
    """Times in seconds from seconds, milli-, micro- or nanoseconds since 1970, by their size."""
    size = float(np.abs(stamps).max(initial=0.0))
    factor = 1e-9 if size > 1e17 else 1e-6 if size > 1e14 else 1e-3 if size > 1e11 else 1.0
    return np.asarray(stamps, np.float64) * factor


def stamp_of(name: str) -> float | None:
    """The time that a file is named by [s], or None: ``1700000000.25.png``, nanoseconds ..."""
    stem = Path(name).name.rpartition(".")[0] or name
    found = re.search(r"(?<!\d)(\d{9,10})[._](\d{1,9})(?!\d)", stem)
    if found:
        return float(f"{found.group(1)}.{found.group(2)}")
    whole = re.search(r"(?<!\d)(\d{10,19})(?!\d)", stem)
    return float(seconds(np.array([float(whole.group(1))]))[0]) if whole else None
