"""Finds the workcell files that come with armsight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armsight.workcell import Workcell

CALIBRATION = ".calibration.toml"
DEFAULT = "ur5_four_cameras"


def folder() -> Path:
    """Where the packaged cells lie: in the wheel, or in the working copy."""
    package = Path(__file__).resolve().parents[1]
    packaged = package / "cells"
    return packaged if packaged.is_dir() else package.parents[1] / "workcells"


def packaged() -> dict[str, Path]:
    """Packaged cells by name, without the blank."""
    files = sorted(f for f in folder().glob("*.toml") if not f.name.endswith(CALIBRATION))
    return {f.stem: f for f in files if f.stem != "blank"}


def load(given: str) -> Workcell:
    """The workcell of a file, or the packaged cell of that name.

    A packaged cell's calibration belongs to whoever uses it, not to the package: it is kept in the
    working folder, as ``NAME.calibration.toml``.

    Raises:
        WorkcellError: it cannot be read or has problems.
    """
    from armsight.workcell import load_workcell

    file = find(given)
    beside = None
    if file.resolve().parent == folder().resolve() and not Path(given).is_file():
        beside = Path.cwd() / f"{file.stem}{CALIBRATION}"
    return load_workcell(file, beside)


def find(given: str) -> Path:
    """A file as given, or the packaged cell of that name (``ur5_four_cameras``)."""
    path = Path(given)
    if path.suffix == "" and not path.exists() and given in packaged():
        return packaged()[given]
    return path
