"""Poses with a file each: files that differ by a number alone are one table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from armsight.calibration.layouts.array_files import ARRAYS, array_tables
from armsight.calibration.layouts.kinds import STRUCTURED, Unread, is_text
from armsight.calibration.layouts.structured import order_of, poses_of_one, read_document
from armsight.calibration.layouts.table import PoseTable, natural, ordinals
from armsight.calibration.layouts.text_table import numbers_of
from armsight.errors import CalibrationError

ENOUGH = 0.6
"""Share of the files of a kind that must hold a pose for them to be poses [1]."""


def alike(files: Sequence[Path]) -> list[list[Path]]:
    """Files that differ by a number alone."""
    groups: dict[tuple[Path, str, str], list[Path]] = {}
    for file in files:
        word = re.sub(r"\d+", "#", file.stem.lower())
        groups.setdefault((file.parent, word, file.suffix.lower()), []).append(file)
    return [sorted(g, key=natural) for g in groups.values()]


def one_each(files: Sequence[Path], root: Path) -> tuple[list[PoseTable], list[Unread]]:
    """Tables of files with a pose each (or several, by name), and the files that have none.

    Args:
        files: that differ by a number alone.
        root: the set's folder, for the table's name.

    Raises:
        CalibrationError: a file is written in another way than the others.
    """
    if len(files) < 3:
        return [], []
    found = {file: _poses(file) for file in files}
    names = dict.fromkeys(name for poses in found.values() for name in poses)
    out = []
    for name in names:
        kept = [f for f in files if name in found[f]]
        if len(kept) >= max(3, ENOUGH * len(files)):
            out.append(_joined([found[f][name] for f in kept], kept, root, name))
    without = [f for f in files if not found[f]] if out else []
    return out, [Unread(f, "no pose in it, unlike the other files of its kind") for f in without]


def _joined(parts: list[PoseTable], files: list[Path], root: Path, name: str) -> PoseTable:
    parts = [_as_in(parts[0], p) for p in parts]
    shape = (parts[0].values.shape[1], parts[0].names)
    odd = [k for k, p in enumerate(parts) if (p.values.shape[1], p.names) != shape]
    if odd:
        raise CalibrationError(
            f"{files[odd[0]]}: is written in another way than {files[0].name}: "
            f"{parts[odd[0]].values.shape[1]} numbers, not {shape[0]}"
        )
    first = parts[0]
    joints = [p.joints for p in parts if p.joints is not None]
    numbers = ordinals([f.name for f in files])
    place = files[0].parent
    here = place == root
    source = f"{files[0].name} and {len(files) - 1} more files" if here else f"{place.name}/"
    return PoseTable(
        f"{source} ({name})" if name else source,
        tuple(f.stem if n is None else str(n) for f, n in zip(files, numbers)),
        np.concatenate([p.values for p in parts]),
        first.names,
        first.length,
        first.angle,
        first.rotation,
        np.concatenate(joints) if len(joints) == len(parts) else None,
        max(p.decimals for p in parts),
    )


def _as_in(first: PoseTable, part: PoseTable) -> PoseTable:
    """A pose with its columns as in the first file: names need keep no order."""
    order = order_of(part.names, first.names)
    return part if order is None else replace(part, values=part.values[:, order], names=first.names)


def _poses(file: Path) -> dict[str, PoseTable]:
    """The poses of a file of its own, by the names that they have there; none where it has none."""
    suffix = file.suffix.lower()
    try:
        if suffix in STRUCTURED:
            return poses_of_one(read_document(file), file.name)
        if is_text(file):
            one = numbers_of(file)
            return {} if one is None else {"": one}
        if suffix in ARRAYS:
            tables = [t for t in array_tables(file) if len(t.values) == 1]
            return {t.source.removeprefix(file.name).strip(" ()"): t for t in tables}
    except CalibrationError:
        pass
    return {}
