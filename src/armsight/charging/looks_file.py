"""Looks of a plug calibration in progress, a JSON line each: a stopped one goes on from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armsight.calibration.views_file import add_row, begin, rows_of
from armsight.charging.calibrate import PlugLook

__all__ = ["append", "begin", "read"]


def append(file: Path, look: PlugLook) -> None:
    """Add a look; each line is whole or not there.

    Raises:
        CalibrationError: the file cannot be written.
    """
    row = {
        "joints": look.joints.tolist(),
        "T_camera_plug": look.T_camera_plug.tolist(),
        "covariance": look.covariance.tolist(),
        "wrench": None if look.wrench is None else look.wrench.tolist(),
    }
    add_row(file, row)


def read(file: Path, about: dict[str, Any]) -> list[PlugLook]:
    """All whole looks of a file; a last line cut short by a stop is dropped.

    Raises:
        CalibrationError: a line in the middle is broken, or the looks are of something else.
    """
    return rows_of(file, about, _look)


def _look(row: dict[str, Any]) -> PlugLook:
    joints = np.array(row["joints"], float)
    T, C = np.array(row["T_camera_plug"], float), np.array(row["covariance"], float)
    felt = row["wrench"]
    wrench = None if felt is None else np.array(felt, float)
    if wrench is not None and (wrench.shape != (6,) or not np.isfinite(wrench).all()):
        raise ValueError("no wrench")
    whole = np.isfinite(joints).all() and np.isfinite(T).all() and np.isfinite(C).all()
    if joints.ndim != 1 or T.shape != (4, 4) or C.shape != (6, 6) or not whole:
        raise ValueError("no look")
    return PlugLook(joints, T, C, wrench)
