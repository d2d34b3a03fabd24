"""Views of a calibration in progress, a JSON line each: a stopped one goes on from them.

The first line says whose views they are, so that those of another cell or board are not mixed in.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from armsight.calibration.live.seen import SeenView
from armsight.errors import CalibrationError

Row = TypeVar("Row")


def begin(file: Path, about: dict[str, Any]) -> None:
    """Start a file of views, or make one that is there ready to be gone on with.

    A last line that a stop has cut short goes: what is appended would be lost with it.

    Args:
        file: JSON lines.
        about: what the views are of, as JSON values; :func:`read` compares it.

    Raises:
        CalibrationError: the file cannot be written.
    """
    try:
        if file.is_file():
            whole = file.read_bytes()
            if not whole.endswith(b"\n"):
                file.write_bytes(whole[: whole.rfind(b"\n") + 1])
    except OSError as error:
        raise CalibrationError(f"{file}: cannot be written: {error.strerror or error}") from None
    if not file.is_file() or not file.stat().st_size:
        add_row(file, {"about": about})


def append(file: Path, view: SeenView) -> None:
    """Add a view; each line is whole or not there.

    Raises:
        CalibrationError: the file cannot be written.
    """
    add_row(file, _to_json(view))


def add_row(file: Path, row: dict[str, Any]) -> None:
    """Add a line, whole or not at all.

    Raises:
        CalibrationError: the file cannot be written.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row, allow_nan=False) + "\n")
            stream.flush()
    except OSError as error:
        raise CalibrationError(f"{file}: cannot be written: {error.strerror or error}") from None


def read(file: Path, about: dict[str, Any] | None = None) -> list[SeenView]:
    """All whole views of a file; see :func:`rows_of`."""
    return rows_of(file, about, _from_json)


def rows_of(
    file: Path, about: dict[str, Any] | None, made: Callable[[dict[str, Any]], Row]
) -> list[Row]:
    """All whole rows of a file; a last line cut short by a stop is dropped.

    Args:
        file: JSON lines; none is there before the first.
        about: what they have to be of.
        made: a row from its JSON; raises ValueError, KeyError or TypeError for one that is none.

    Raises:
        CalibrationError: a line in the middle is broken, or the views are of something else.
    """
    if not file.is_file():
        return []
    out: list[Row] = []
    try:
        rows = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{file}: cannot be read: {error}") from None
    for number, row in enumerate(rows, 1):
        try:
            document = json.loads(row)
            if number == 1 and "about" in document:
                _same(file, document["about"], about)
                continue
            out.append(made(document))
        except (ValueError, KeyError, TypeError):
            if number == len(rows):
                break
            raise CalibrationError(
                f"{file}, line {number}: is not a view; delete the file to start anew"
            ) from None
    return out


def _same(file: Path, found: Any, about: dict[str, Any] | None) -> None:
    for key, value in (about or {}).items():
        other = found.get(key) if isinstance(found, dict) else None
        if other != value:
            raise CalibrationError(
                f"{file}: its views are of {key} {other}, not {value}; use --fresh to start anew, "
                "or another --out"
            )


def _to_json(view: SeenView) -> dict[str, Any]:
    return {
        "joints": [float(v) for v in view.joints],
        "stage": view.stage,
        "stamp": float(view.stamp),
        "found": [
            [int(k), [int(c) for c in corner], [[float(x) for x in p] for p in pixel]]
            for k, corner, pixel in view.found
        ],
        "missed": [[int(k), reason] for k, reason in view.missed],
        "depth": [
            [int(c), [[float(x) for x in p] for p in pixel], [float(v) for v in z]]
            for c, pixel, z in view.depth
        ],
    }


def _from_json(row: dict[str, Any]) -> SeenView:
    return SeenView(
        np.array(row["joints"], float),
        str(row["stage"]),
        float(row["stamp"]),
        tuple((int(k), np.array(c, np.int64), np.array(p, float)) for k, c, p in row["found"]),
        tuple((int(k), str(r)) for k, r in row["missed"]),
        tuple((int(c), np.array(p, float), np.array(z, float)) for c, p, z in row["depth"]),
    )
