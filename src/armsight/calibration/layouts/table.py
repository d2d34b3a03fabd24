"""Rows of numbers that may be poses, as a file gives them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from armsight.arrays import Floats, Ints
from armsight.errors import CalibrationError

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
