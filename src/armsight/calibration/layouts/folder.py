"""What lies in a folder: series of pictures, one a camera, and everything else."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from armsight.calibration.layouts.array_files import ARRAYS, array_tables, stacked_tables
from armsight.calibration.layouts.kinds import BAGS, NOT_READ, STRUCTURED, Unread, is_text
from armsight.calibration.layouts.loose_text import loose_tables, program_tables
from armsight.calibration.layouts.pose_files import alike, one_each
from armsight.calibration.layouts.series import PICTURES, Series, series_of
from armsight.calibration.layouts.structured import read_document, structured_tables
from armsight.calibration.layouts.table import PoseTable, natural
from armsight.calibration.layouts.text_table import text_tables
from armsight.errors import CalibrationError

DEEPEST = 3
MOST_FILES = 60_000


@dataclass(frozen=True)
class Folder:
    """A folder, listed.

    Attributes:
        path: where.
        series: pictures by camera, the longest first.
        aside: pictures that are no views (depth, masks), or stand apart.
        others: all other files.
    """

    path: Path
    series: tuple[Series, ...]
    aside: tuple[Path, ...]
    others: tuple[Path, ...]


def list_folder(path: Path) -> Folder:
    """List a folder and those in it.

    Raises:
        CalibrationError: there is none, or it holds more files than a recorded set can.
    """
    if not path.is_dir():
        raise CalibrationError(f"{path}: no such folder")
    pictures: list[Path] = []
    others: list[Path] = []
    count = 0
    for place, folders, files in os.walk(path):
        here = Path(place)
        depth = len(here.relative_to(path).parts)
        folders[:] = sorted(f for f in folders if not f.startswith(".") and depth < DEEPEST)
        for name in files:
            count += 1
            if count > MOST_FILES:
                raise CalibrationError(
                    f"{path}: more than {MOST_FILES} files; give the folder of one recording"
                )
            file = here / name
            if name.startswith("."):
                continue
            (pictures if file.suffix.lower() in PICTURES else others).append(file)
    series, aside = series_of(path, pictures)
    return Folder(path, series, aside, tuple(sorted(others, key=natural)))


def pose_tables(
    folder: Folder, pictures: int, skip: Callable[[Path], bool] = lambda _: False
) -> tuple[list[PoseTable], list[Unread]]:
    """Every table of poses that the files beside the pictures may hold, and the files without.

    Args:
        folder: listed.
        pictures: how many a camera has.
        skip: files that are known to be something else (a lens, corners).
    """
    tables: list[PoseTable] = []
    unread: list[Unread] = []
    rest: list[Path] = []
    for group in alike([f for f in folder.others if not skip(f)]):
        try:
            found, without = one_each(group, folder.path)
        except CalibrationError as error:
            unread.append(Unread(group[0], str(error)))
            continue
        if found:
            tables += found
            unread += without
        else:
            rest += group
    for file in rest:
        try:
            found_here = _tables_of(file, pictures)
        except CalibrationError as error:
            unread.append(Unread(file, str(error)))
            continue
        if found_here:
            tables += found_here
        elif is_text(file) or file.suffix.lower() in (*STRUCTURED, *ARRAYS):
            unread.append(Unread(file, "no poses in it"))
    if not tables:
        tables = program_tables(folder.others)
    return tables, unread


def _tables_of(file: Path, pictures: int) -> list[PoseTable]:
    suffix = file.suffix.lower()
    if suffix in BAGS:
        raise CalibrationError(
            f"{file}: a recording of ROS is not read; save its pictures as files, and the pose at "
            "each as a line of poses.csv"
        )
    if suffix in ARRAYS:
        return array_tables(file)
    if suffix in STRUCTURED:
        document = read_document(file)
        return structured_tables(document, file.name) or stacked_tables(document, file.name)
    if suffix in NOT_READ:
        raise CalibrationError(f"{file}: {NOT_READ[suffix]}")
    if is_text(file):
        return text_tables(file, pictures) or loose_tables(file)
    return []
