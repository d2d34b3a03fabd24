"""Finds the workcell files that come with armsight."""

from __future__ import annotations

from pathlib import Path

DEFAULT = "ur5_four_cameras"


def folder() -> Path:
    """Where the packaged cells lie: in the wheel, or in the working copy."""
    package = Path(__file__).resolve().parents[1]
    packaged = package / "cells"
    return packaged if packaged.is_dir() else package.parents[1] / "workcells"


def packaged() -> dict[str, Path]:
    """Packaged cells by name, without the blank."""
    return {f.stem: f for f in sorted(folder().glob("*.toml")) if f.stem != "blank"}


def find(given: str) -> Path:
    """A file as given, or the packaged cell of that name (``ur5_four_cameras``)."""
    path = Path(given)
    if path.suffix == "" and not path.exists() and given in packaged():
        return packaged()[given]
    return path
