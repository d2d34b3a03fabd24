"""What lies in a folder: series of pictures, one a camera, and everything else."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from armsight.calibration.layouts.matlab import matlab_tables
from armsight.calibration.layouts.structured import read_document, structured_tables
from armsight.calibration.layouts.table import PoseTable, natural, ordinals
from armsight.calibration.layouts.text_table import numbers_of, text_tables
from armsight.errors import CalibrationError

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp", ".jp2")
STRUCTURED = (".yaml", ".yml", ".json", ".xml")
TEXT = (
    *(".txt", ".csv", ".tsv", ".dat", ".src", ".mod", ".modx", ".prg", ".script", ".urscript"),
    *(".log", ".m", ".pose", ".tfm", ".asc", ".tum", ".pos", ".tf", ""),
)
BAGS = (".bag", ".mcap", ".db3")
ASIDE = re.compile(
    r"depth|mask|disp|label|seg(ment)?|result|corner|annot|overlay|debug|vis\b|undist|rectif",
    re.IGNORECASE,
)
"""Words that mark pictures which are no views of the board."""
DEEPEST = 3
MOST_FILES = 60_000


@dataclass(frozen=True)
class Series:
    """Pictures of one camera, in natural order.

    Attributes:
        name: of the camera, from the folder or the files' common words.
        files: the pictures.
        numbers: of each, the number that tells it from the others.
    """

    name: str
    files: tuple[Path, ...]
    numbers: tuple[int | None, ...]


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
    series, aside = _series(path, pictures)
    return Folder(path, series, aside, tuple(sorted(others, key=natural)))


def _series(root: Path, pictures: list[Path]) -> tuple[tuple[Series, ...], tuple[Path, ...]]:
    views = [p for p in pictures if not ASIDE.search(str(p.relative_to(root)))]
    aside = [p for p in pictures if p not in set(views)]
    if not views:  # a set that happens to be called so
        views, aside = pictures, []
    patterns: dict[tuple[Path, str], list[Path]] = {}
    for p in views:
        word = re.sub(r"\d+", "#", p.stem.lower())
        patterns.setdefault((p.parent, word), []).append(p)
    groups: dict[tuple[Path, str], list[Path]] = {}
    for folder in sorted({f for f, _ in patterns}):
        mine = {w: files for (f, w), files in patterns.items() if f == folder}
        large = {w: files for w, files in mine.items() if len(files) >= 3}
        most = max((len(v) for v in large.values()), default=0)
        cameras = {w: v for w, v in large.items() if len(v) >= 0.6 * most}
        total = sum(len(v) for v in mine.values())
        if cameras and sum(len(v) for v in cameras.values()) >= 0.6 * total:
            for word, files in cameras.items():
                groups[folder, word] = files
            aside += [p for w, v in mine.items() if w not in cameras for p in v]
        else:  # names without a pattern
            groups[folder, ""] = [p for v in mine.values() for p in v]
    most = max((len(v) for v in groups.values()), default=0)
    out = []
    for (folder, word), files in groups.items():
        if len(files) < 0.3 * most and len(files) < 8:
            aside += files
            continue
        files = sorted(files, key=natural)
        out.append(
            Series(_name(root, folder, word, groups), tuple(files), tuple(ordinals(_stems(files))))
        )
    out.sort(key=lambda s: -len(s.files))
    return tuple(out), tuple(sorted(aside, key=natural))


def _stems(files: Sequence[Path]) -> list[str]:
    return [f.name for f in files]


def _name(root: Path, folder: Path, word: str, groups: dict[tuple[Path, str], list[Path]]) -> str:
    """A camera's name: by its folder where cameras have folders, else by its files' words."""
    if len(groups) == 1:
        return "camera"
    alone = sum(f == folder for f, _ in groups) == 1
    if alone and folder != root:
        parts = [p for p in folder.relative_to(root).parts if p.lower() not in ("images", "data")]
        return "_".join(parts) or folder.name
    return re.sub(r"[#\W_]+", "_", word).strip("_") or folder.name


@dataclass(frozen=True)
class Unread:
    """A file that holds no poses for us, and why."""

    file: Path
    reason: str


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
    for group in _one_a_pose(folder.others):
        found = _one_each(group, folder.path) if len(group) >= 3 else None
        if found is None:
            rest += group
        else:
            tables.append(found)
    for file in rest:
        if skip(file):
            continue
        try:
            found_here = _tables_of(file, pictures)
        except CalibrationError as error:
            unread.append(Unread(file, str(error)))
            continue
        if found_here:
            tables += found_here
        elif file.suffix.lower() in (*TEXT, *STRUCTURED, ".mat"):
            unread.append(Unread(file, "no poses in it"))
    return tables, unread


def _tables_of(file: Path, pictures: int) -> list[PoseTable]:
    suffix = file.suffix.lower()
    if suffix in BAGS:
        raise CalibrationError(
            f"{file}: a recording of ROS is not read; save its pictures as files, and the pose at "
            "each as a line of poses.csv"
        )
    if suffix == ".mat":
        return matlab_tables(file)
    if suffix in STRUCTURED:
        return structured_tables(read_document(file), file.name)
    if suffix in TEXT:
        return text_tables(file, pictures)
    return []


def _one_a_pose(files: Sequence[Path]) -> list[list[Path]]:
    """Files that differ by a number alone."""
    groups: dict[tuple[Path, str, str], list[Path]] = {}
    for file in files:
        word = re.sub(r"\d+", "#", file.stem.lower())
        groups.setdefault((file.parent, word, file.suffix.lower()), []).append(file)
    return [sorted(g, key=natural) for g in groups.values()]


def _one_each(files: list[Path], root: Path) -> PoseTable | None:
    """One table of files with a pose each; None when they are something else."""
    parts: list[PoseTable] = []
    kept: list[Path] = []
    for file in files:
        one = _single(file)
        if one is None:
            continue
        parts.append(one)
        kept.append(file)
    if len(parts) < max(3, 0.6 * len(files)):
        return None
    shape = (parts[0].values.shape[1], parts[0].names)
    same = [k for k, p in enumerate(parts) if (p.values.shape[1], p.names) == shape]
    if len(same) < len(parts):
        odd = next(k for k in range(len(parts)) if k not in same)
        raise CalibrationError(
            f"{kept[odd]}: is written in another way than {kept[same[0]].name}: "
            f"{parts[odd].values.shape[1]} numbers, not {shape[0]}"
        )
    import numpy as np

    first = parts[0]
    joints = [p.joints for p in parts]
    whole = all(j is not None for j in joints)
    numbers = ordinals([f.name for f in kept])
    place = files[0].parent
    source = files[0].name if place == root else place.name
    return PoseTable(
        f"{source} and {len(kept) - 1} more files" if place == root else f"{source}/",
        tuple(f.stem if n is None else str(n) for f, n in zip(kept, numbers)),
        np.concatenate([p.values for p in parts]),
        first.names,
        first.length,
        first.angle,
        first.rotation,
        np.concatenate([j for j in joints if j is not None]) if whole else None,
        max(p.decimals for p in parts),
    )


def _single(file: Path) -> PoseTable | None:
    suffix = file.suffix.lower()
    try:
        if suffix in STRUCTURED:
            for table in structured_tables(read_document(file), file.name):
                if len(table.values) == 1:
                    return table
            return None
        if suffix in TEXT:
            return numbers_of(file)
        if suffix == ".mat":
            tables = matlab_tables(file)
            for table in tables:
                if table.values.shape == (4, 4):
                    return PoseTable(table.source, ("",), table.values.reshape(1, 16))
                if len(table.values) == 1:
                    return table
    except CalibrationError:
        return None
    return None
