"""What is needed to come out again and home, on disk from the first look until the stand-by.

A station that is killed and started again reads it: whether it may be plugged in, where the port
is, how the plug hung and what the force sensor said without contact.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.errors import ArmsightError
from armsight.geometry.pose import is_rotation
from armsight.writing import write_text

VERSION = 3
MOST = 100_000
"""A longer file is none of ours [bytes]."""


class JournalError(ArmsightError):
    """The journal cannot be read or written."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One visit that is under way.

    Attributes:
        port: type of the inlet; plug: type of the plug.
        T_base_port: where the port is; covariance: (6, 6) of that, as a twist in its own frame.
        T_flange_plug: how the plug hangs, by its own weight and cable.
        tare: (6,) what the force sensor says without contact [N], [N m]; None before it was asked:
            the plug has not been near the port yet.
        plugged: the plug was seated; else it was on its way in or out.
        T_base_lid: a lid that this station has opened, or works at; None without one.
        at_lid: the finger works at it; the plug is out.
    """

    port: str
    plug: str
    T_base_port: Pose
    covariance: Floats
    T_flange_plug: Pose
    tare: Floats | None = None
    plugged: bool = False
    T_base_lid: Pose | None = None
    at_lid: bool = False


class Journal:
    """The one file of a station. A journal without a file remembers nothing: for trials.

    Args:
        file: where it is kept, or None.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file

    def write(self, entry: Entry) -> None:
        """Keep an entry, whole or not at all; on disk when this returns.

        Raises:
            JournalError: it cannot be written; then nobody may plug in.
        """
        if self.file is None:
            return
        data = {
            "version": VERSION,
            "port": entry.port,
            "plug": entry.plug,
            "T_base_port": entry.T_base_port.tolist(),
            "covariance": entry.covariance.tolist(),
            "T_flange_plug": entry.T_flange_plug.tolist(),
            "tare": None if entry.tare is None else entry.tare.tolist(),
            "plugged": entry.plugged,
            "T_base_lid": None if entry.T_base_lid is None else entry.T_base_lid.tolist(),
            "at_lid": entry.at_lid,
        }
        write_text(self.file, json.dumps(data, indent=1, allow_nan=False) + "\n", JournalError)
        _settle(self.file)

    def clear(self) -> None:
        """The arm is where it waits: nothing is under way.

        Raises:
            JournalError: the file cannot be removed.
        """
        if self.file is None:
            return
        try:
            self.file.unlink(missing_ok=True)
        except OSError as error:
            raise JournalError(f"{self.file}: cannot be removed: {error.strerror}") from None

    def read(self) -> Entry | None:
        """What is under way; None when nothing is.

        Raises:
            JournalError: the file is there and cannot be believed; somebody has to look whether
                the plug is in the car.
        """
        if self.file is None:
            return None
        hint = "look whether the plug is in the car, bring the arm out by hand and remove the file"
        try:
            text = self.file.read_bytes()[: MOST + 1]
            if len(text) > MOST:
                raise ValueError("is too long")
            return _entry(json.loads(text.decode()))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise JournalError(f"{self.file}: cannot be read: {error.strerror}; {hint}") from None
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise JournalError(f"{self.file}: is no journal ({error}); {hint}") from None


def _settle(file: Path) -> None:
    """Have the folder's own entry on disk, too; some file systems do not offer that."""
    with suppress(OSError):
        folder = os.open(os.path.realpath(file.parent), os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _entry(data: object) -> Entry:
    if not isinstance(data, dict) or data.get("version") != VERSION:
        raise ValueError(f"expected a journal of version {VERSION}")
    tare = None if data["tare"] is None else _numbers(data["tare"], (6,), "tare")
    covariance = _numbers(data["covariance"], (6, 6), "covariance")
    if np.linalg.eigvalsh(covariance).min() < -1e-12:
        raise ValueError("covariance is none")
    plugged, at_lid, lid = data["plugged"], data["at_lid"], data["T_base_lid"]
    for name, value in (("plugged", plugged), ("at_lid", at_lid)):
        if not isinstance(value, bool):
            raise ValueError(f"{name} is neither true nor false")
    if at_lid and lid is None:
        raise ValueError("it works at a lid, but T_base_lid is none")
    for name in ("port", "plug"):
        if not isinstance(data[name], str):
            raise ValueError(f"{name} is no text")
    return Entry(
        data["port"],
        data["plug"],
        _pose(data["T_base_port"], "T_base_port"),
        covariance,
        _pose(data["T_flange_plug"], "T_flange_plug"),
        tare,
        plugged,
        None if lid is None else _pose(lid, "T_base_lid"),
        at_lid,
    )


def _numbers(value: object, shape: tuple[int, ...], name: str) -> Floats:
    numbers = np.asarray(value, float)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is no {shape} of numbers")
    return numbers


def _pose(value: object, name: str) -> Pose:
    T = _numbers(value, (4, 4), name)
    if not is_rotation(T[:3, :3]):
        raise ValueError(f"{name} is no pose")
    return T
