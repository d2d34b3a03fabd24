"""Poses in MATLAB's ``.mat`` files: stacks of 4x4, or a row a pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armsight.calibration.layouts.table import LARGEST, PoseTable
from armsight.errors import CalibrationError


def matlab_tables(file: Path) -> list[PoseTable]:
    """Every array of a MATLAB file that may be poses.

    Raises:
        CalibrationError: it cannot be read, or is of the HDF5 kind (-v7.3).
    """
    from scipy.io import loadmat

    try:
        if file.stat().st_size > 4 * LARGEST:
            raise CalibrationError(f"{file}: is larger than {4 * LARGEST >> 20} MiB")
        if file.read_bytes()[:10].startswith(b"MATLAB 7.3"):
            raise CalibrationError(
                f"{file}: is of MATLAB's version 7.3, which armsight does not read; save it with "
                "-v7, or as text"
            )
        content = loadmat(str(file))
    except CalibrationError:
        raise
    except Exception as error:  # loadmat raises whatever a broken file makes it stumble over
        raise CalibrationError(f"{file}: cannot be read as a MATLAB file: {error}") from None
    out = []
    for name, value in content.items():
        if name.startswith("__"):
            continue
        table = _table(np.asarray(value), f"{file.name} ({name})")
        if table is not None:
            out.append(table)
    return out


def _table(value: np.ndarray, source: str) -> PoseTable | None:
    if value.dtype == object:  # a cell array, a pose a cell
        cells = [np.asarray(c) for c in value.ravel()]
        if not cells or any(c.dtype.kind not in "fiu" or c.shape != cells[0].shape for c in cells):
            return None
        value = np.stack(cells)
    if value.dtype.kind not in "fiu":
        return None
    value = np.asarray(value, float)
    if value.ndim == 3:
        if value.shape[1:] not in ((4, 4), (3, 4)):
            value = np.moveaxis(value, 2, 0)  # MATLAB stacks along the third
        if value.shape[1:] in ((4, 4), (3, 4)):
            flat = value.reshape(len(value), -1)
            return PoseTable(source, ("",) * len(flat), flat)
        if value.shape[1] == 1 or value.shape[2] == 1:
            value = value.reshape(len(value), -1)
        else:
            return None
    if value.ndim != 2:
        return None
    n, m = value.shape
    if m == 4 and n % 4 == 0 and n > 4:  # blocks below each other
        return PoseTable(source, ("",) * (n // 4), value.reshape(-1, 16))
    if n == 4 and m % 4 == 0 and m > 4:  # blocks beside each other
        blocks = np.stack(np.hsplit(value, m // 4)).reshape(-1, 16)
        return PoseTable(source, ("",) * len(blocks), blocks)
    if m not in (6, 7, 12, 16) and n in (6, 7, 12, 16):
        value = value.T
        n, m = value.shape
    if m >= 6 and n >= 1 and not (m > 20 and n < m):
        return PoseTable(source, ("",) * n, value)
    return None
