"""Writes what a calibration has found into the cell's calibration file, whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from armsight.errors import CalibrationError
from armsight.workcell.calibration_file.schema import (
    CalibratedArm,
    CalibratedBoard,
    CalibratedCamera,
    CalibratedPlug,
    CalibratedStereo,
)
from armsight.workcell.calibration_file.writing import updated
from armsight.workcell.schema import Workcell
from armsight.writing import write_atomically


def store(
    workcell: Workcell,
    cameras: Sequence[CalibratedCamera],
    arm: CalibratedArm | None = None,
    board: CalibratedBoard | None = None,
    stereo: Sequence[CalibratedStereo] = (),
    plug: CalibratedPlug | None = None,
) -> Path:
    """Put entries into the cell's calibration file; what else stands there is kept.

    Returns:
        The file.

    Raises:
        CalibrationError: the cell has no file of its own, or it cannot be written.
        WorkcellError: the file that is there is broken.
    """
    file = workcell.calibration_file
    if file is None:
        raise CalibrationError(f"{workcell.name}: came from no file, so nothing can be kept")
    try:
        text = file.read_text(encoding="utf-8") if file.is_file() else ""
        new = updated(text, workcell, cameras, arm, str(file), board, stereo, plug)
        write_atomically(file, new.encode())
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{file}: cannot be written: {error}") from None
    return file
