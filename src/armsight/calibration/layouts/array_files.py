"""Arrays in binary files: MATLAB's ``.mat``, numpy's ``.npy`` and ``.npz`` (never its pickles)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from armsight.calibration.layouts.structured import structured_tables
from armsight.calibration.layouts.table import LARGEST, PoseTable
from armsight.errors import CalibrationError

ARRAYS = (".mat", ".npy", ".npz")
MOST = 4 * LARGEST
"""Bytes of such a file, unpacked, at most."""


def read_arrays(file: Path) -> dict[str, np.ndarray]:
    """The arrays of a file by name; a lone one has the file's.

    Raises:
        CalibrationError: it cannot be read, is too large, or is of a kind that is not read.
    """
    try:
        if file.stat().st_size > MOST:
            raise CalibrationError(f"{file}: is larger than {MOST >> 20} MiB")
        return _matlab(file) if file.suffix.lower() == ".mat" else _numpy(file)
    except CalibrationError:
        raise
    except Exception as error:  # readers raise whatever a broken file makes them stumble over
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise CalibrationError(f"{file}: cannot be read as a file of arrays: {reason}") from None


def _matlab(file: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    with file.open("rb") as stream:
        if stream.read(10).startswith(b"MATLAB 7.3"):
            raise CalibrationError(
                f"{file}: is of MATLAB's version 7.3, which armsight does not read; save it with "
                "-v7, or as text"
            )
    found = loadmat(str(file))
    return {name: np.asarray(v) for name, v in found.items() if not name.startswith("__")}


def _numpy(file: Path) -> dict[str, np.ndarray]:
    if file.suffix.lower() == ".npz":
        with zipfile.ZipFile(file) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MOST:
                raise CalibrationError(f"{file}: unpacks to more than {MOST >> 20} MiB")
    try:
        found = np.load(file, allow_pickle=False)
        if isinstance(found, np.ndarray):
            return {file.stem: found}
        with found:
            return {name: np.asarray(found[name]) for name in found.files}
    except ValueError as error:
        if "pickle" not in str(error).lower():
            raise
        raise CalibrationError(
            f"{file}: holds Python objects, which armsight does not load (they can run programs); "
            "save plain arrays"
        ) from None


def array_tables(file: Path) -> list[PoseTable]:
    """Every array of a file that may be poses.

    Raises:
        CalibrationError: see :func:`read_arrays`.
    """
    arrays = read_arrays(file)
    out = []
    for name, value in arrays.items():
        table = _table(value, file.name if name == file.stem else f"{file.name} ({name})")
        if table is not None:
            out.append(table)
    return out or _joined(arrays, file.name)


def stacked_tables(document: Any, source: str) -> list[PoseTable]:
    """Rotations and positions that a document keeps in two stacks (OpenCV's ``R_gripper2base``)."""
    if not isinstance(document, dict):
        return []
    arrays: dict[str, np.ndarray] = {}
    for key, value in document.items():
        if isinstance(value, list) and len(value) > 2:
            try:
                arrays[str(key)] = np.array(value, float)
            except (TypeError, ValueError):
                continue
    return _joined(arrays, source) if len(arrays) > 1 else []


def as_document(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Small arrays of numbers as lists, for readers of mappings."""
    return {
        name: value.item() if value.size == 1 else value.tolist()
        for name, value in arrays.items()
        if value.dtype.kind in "fiu" and 0 < value.size <= 64
    }


def _joined(arrays: dict[str, np.ndarray], source: str) -> list[PoseTable]:
    """Rotations in one array, positions in another: of one pose, or stacked."""
    one = structured_tables(as_document(arrays), source)
    if one:
        return one
    plain = {k: np.squeeze(v) for k, v in arrays.items() if v.dtype.kind in "fiu"}
    places = {k: v for k, v in plain.items() if v.ndim == 2 and v.shape[1] == 3}
    turns = {k: v for k, v in plain.items() if v.shape[1:] in ((3, 3), (4,), (3,))}
    out = []
    for a, t in places.items():
        for b, r in turns.items():
            if a == b or len(t) != len(r) or (r.ndim == 2 and r.shape[1] == 3 and a > b):
                continue
            T = np.zeros((len(t), 3, 4))
            if r.ndim == 3:
                T[:, :, :3], T[:, :, 3] = r, t
                value = T.reshape(len(t), 12)
            else:
                value = np.hstack([t, r])
            out.append(PoseTable(f"{source} ({a}, {b})", ("",) * len(t), value))
    return out


def _table(value: np.ndarray, source: str) -> PoseTable | None:
    if value.dtype == object:  # a cell array, a pose a cell
        cells = [np.asarray(c) for c in value.ravel()]
        if not cells or any(c.dtype.kind not in "fiu" or c.shape != cells[0].shape for c in cells):
            return None
        value = np.stack(cells)
    if value.dtype.kind not in "fiu" or value.size > LARGEST:
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
    if value.ndim == 1 and len(value) in (6, 7, 12, 16):
        value = value[None]
    if value.ndim != 2:
        return None
    n, m = value.shape
    if (n, m) == (4, 4):
        return PoseTable(source, ("",), value.reshape(1, 16))
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
