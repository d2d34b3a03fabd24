"""A recorded set: pictures (or corners) and poses of a folder, in whatever layout, read.

``docs/calibration.md`` lists the layouts. Poses are brought to ``T_base_flange``; what was read,
and as what, is kept for a table with the next reading of the poses beside the one taken.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, Ints, Poses
from armsight.calibration.boards import Board
from armsight.calibration.findings import Finding
from armsight.calibration.layouts.bags import bag_in, unpack
from armsight.calibration.layouts.board_files import board_of
from armsight.calibration.layouts.choice import Choice
from armsight.calibration.layouts.direction import settle_direction
from armsight.calibration.layouts.folder import Folder, list_folder, pose_tables
from armsight.calibration.layouts.joint_angles import in_radians, joint_tables
from armsight.calibration.layouts.kinds import Unread
from armsight.calibration.layouts.lens_choice import GivenLens, given_lens
from armsight.calibration.layouts.lens_files import LensFile
from armsight.calibration.layouts.series import Series
from armsight.calibration.layouts.table import PoseTable
from armsight.calibration.pictures import Seen
from armsight.calibration.pose_reading import read_poses
from armsight.calibration.problem import Mount
from armsight.calibration.set_pictures import shown_in
from armsight.errors import CalibrationError
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class RecordedCamera:
    """What one camera of a set saw.

    Attributes:
        name: of the camera.
        mount: what carries it.
        seen: its pictures.
        view: (n,) of each picture, its row among the set's poses; -1 where it has none.
        lens: given with the set, or None.
        choice: how its poses were read; None without poses.
    """

    name: str
    mount: Mount
    seen: Seen
    view: Ints
    lens: LensFile | None
    choice: Choice | None = None


@dataclass(frozen=True)
class ReadAs:
    """One line of the table of what was read: the thing, as what, and how else it may be read."""

    what: str
    read_as: str
    otherwise: str = ""


@dataclass(frozen=True)
class RecordedSet:
    """A folder, read.

    Attributes:
        folder: where.
        board: what was looked for.
        cameras: that took its pictures.
        poses: (v, 4, 4) ``T_base_flange`` of each view, or None for pictures alone.
        joints: (v, j) [rad], or None.
        names: of the views, by their pictures.
        read_as: the table of what was read.
        findings: what was odd about the files.
    """

    folder: Path
    board: Board
    cameras: tuple[RecordedCamera, ...]
    poses: Poses | None
    joints: Floats | None
    names: tuple[str, ...]
    read_as: tuple[ReadAs, ...] = ()
    findings: tuple[Finding, ...] = ()


def load(
    folder: Path,
    board: Board | None = None,
    lens_file: Path | None = None,
    progress: Callable[[str], None] | None = None,
    mount: Mount | None = None,
    robot: Robot | None = None,
) -> RecordedSet:
    """Read a folder and find the board in its pictures.

    Args:
        folder: pictures and poses, in any layout.
        board: what to look for; None when the folder itself says so.
        lens_file: of the camera.
        progress: called with each picture's name.
        mount: where the camera is, when the user says so; the data tell otherwise.
        robot: the arm, so that joint angles are poses, too.

    Raises:
        CalibrationError: nothing usable is there; says what is missing.
    """
    listed = None if folder.is_file() else list_folder(folder)
    if listed is None or not listed.series:
        bag = bag_in(folder, listed.others if listed is not None else (folder,))
        if bag is not None:
            with tempfile.TemporaryDirectory() as place:
                unpack(bag, Path(place))
                inner = load(Path(place), board, lens_file, progress, mount, robot)
                return replace(inner, folder=folder)
    if listed is None:
        raise CalibrationError(f"{folder}: is a file; give a folder of pictures and poses")
    board = board or board_of(listed.others)
    if board is None:
        raise CalibrationError(
            f"{folder}: which board? give --board, such as checkerboard:7x5:30 or charuco:5x7:36:27"
        )
    findings: list[Finding] = []
    shown = shown_in(listed, board, progress)
    board, series, seen = shown.board, shown.series, shown.seen
    findings += shown.findings
    rows = _board_rows(board, findings)
    lenses = tuple(
        given_lens(listed.others, lens_file, s.name, v.size or (0, 0), len(series))
        for s, v in zip(series, seen)
    )
    for s, found in zip(series, lenses):
        findings += found.findings
        rows.append(ReadAs(f"lens of {s.name}", found.words))
    skip = shown.files | {f for found in lenses for f in found.files}
    tables, unread = pose_tables(listed, len(series[0].files), lambda f: f in skip)
    if robot is not None:
        tables = [*map(in_radians, tables), *joint_tables(tables, robot)]
    if not tables:
        return _lens_frames(folder, board, series, seen, lenses, mount, unread, rows, findings)
    return _with_poses(
        folder, board, series, seen, lenses, mount, tables, unread, listed, rows, findings
    )


def _board_rows(board: Board, findings: Sequence[Finding]) -> list[ReadAs]:
    """The board as it was read, and below it why not as it was named."""
    why = [f.message for f in findings if f.code == "board_count"]
    return [ReadAs("board", board.describe()), *(ReadAs("", message) for message in why)]


def _lens_frames(
    folder: Path,
    board: Board,
    series: Sequence[Series],
    seen: Sequence[Seen],
    lenses: Sequence[GivenLens],
    mount: Mount | None,
    unread: Sequence[Unread],
    rows: list[ReadAs],
    findings: list[Finding],
) -> RecordedSet:
    """Pictures without poses: a lens calibration."""
    tried = "; ".join(f"{u.file.name}: {_short(u)}" for u in unread[:5]) or "no other files"
    like = [u for u in unread if "pose" in u.file.stem.lower() or "robot" in u.file.stem.lower()]
    if like:
        raise CalibrationError(like[0].reason if str(like[0].file) in like[0].reason else
                               f"{like[0].file}: {like[0].reason}")  # fmt: skip
    if mount is not None:
        said = "--hand" if mount == "flange" else "--beside"
        raise CalibrationError(
            f"{folder}: {said} needs the arm's poses, and none were found ({tried}); give "
            "poses.csv with a header such as image,x,y,z,qx,qy,qz,qw (the flange in the base)"
        )
    rows.append(ReadAs("poses", f"none found ({tried}): the lens alone is calibrated"))
    cameras = tuple(
        RecordedCamera(s.name, "base", v, np.full(len(v.names), -1), found.lens)
        for s, v, found in zip(series, seen, lenses)
    )
    return RecordedSet(folder, board, cameras, None, None, (), tuple(rows), tuple(findings))


def _short(unread: Unread) -> str:
    return unread.reason.removeprefix(f"{unread.file}: ")


def _with_poses(
    folder: Path,
    board: Board,
    series: Sequence[Series],
    seen: Sequence[Seen],
    lenses: Sequence[GivenLens],
    mount: Mount | None,
    tables: list[PoseTable],
    unread: Sequence[Unread],
    listed: Folder,
    rows: list[ReadAs],
    findings: list[Finding],
) -> RecordedSet:
    """Pictures with poses: each camera's reading of them, the first one's table for all."""
    order = sorted(
        range(len(series)), key=lambda k: -sum(d is not None for d in seen[k].detections)
    )
    choices: dict[int, Choice | None] = {}
    looked = list(seen)
    for k in order:
        looked[k], choices[k] = read_poses(board, series[k], seen[k], lenses[k].lens, tables, mount)
        if choices[k] is not None and len(tables) > 1:
            taken = choices[k].best.reading.table  # type: ignore[union-attr]
            tables = [taken]  # one arm: what was told by one camera holds for all
    points = np.asarray(board.points, np.float64)
    choices = settle_direction(choices, mount, 0.5 * (points.max(0) + points.min(0)))
    strangers = _strangers(series, choices)
    if strangers:
        findings += [_not_of_these_poses(series[k].name) for k in strangers]
        order = [k for k in order if k not in strangers]
    first = choices[order[0]]
    reading = first.best.reading if first is not None else None
    table = reading.table if reading is not None else tables[0]
    poses = first.poses() if first is not None else None
    if poses is None:
        from armsight.calibration.layouts.conventions import readings

        meanings = readings(table)
        poses = meanings[0].poses() if meanings else np.tile(np.eye(4), (len(table.values), 1, 1))
    names = [str(k) for k in range(1, len(table.values) + 1)]
    cameras = []
    for k, (s, v) in enumerate(zip(series, looked)):
        if k in strangers:
            continue
        choice = choices[k]
        view = np.full(len(v.names), -1)
        if choice is not None:
            view[choice.best.pairing.picture] = choice.best.pairing.row
        else:
            m = min(len(view), len(table.values))
            view[:m] = np.arange(m)
        for picture, row in zip(v.names, view):
            if row >= 0 and names[row].isdigit():
                names[row] = picture
        carried: Mount = choice.best.mount if choice is not None else (mount or "base")
        cameras.append(RecordedCamera(s.name, carried, v, view, lenses[k].lens, choice))
        if choice is not None:
            findings += [
                f for f in choice.findings if f.message not in {g.message for g in findings}
            ]
            rows.append(_pose_row(s.name, len(series), choice))
        unpaired = int(np.sum(view < 0))
        tied_by_time = choice is not None and choice.best.pairing.words == "by time"
        if unpaired or (len(table.values) != len(v.names) and not tied_by_time):
            findings.append(
                Finding(
                    "unpaired",
                    "warning" if unpaired > 0.5 * len(view) else "note",
                    f"{len(v.names)} pictures of {s.name} and {len(table.values)} poses in "
                    f"{table.source}: {len(view) - unpaired} pairs",
                    "number pictures and poses alike",
                )
            )
    other = [f"{u.file.name} ({_short(u)})" for u in unread]
    other += [f"{f.name} (no view of the board)" for f in listed.aside[:3]]
    if other:
        rows.append(ReadAs("not read", "; ".join(other[:6])))
    return RecordedSet(
        folder, board, tuple(cameras), poses, table.joints, tuple(names), tuple(rows),
        tuple(findings),
    )  # fmt: skip


def _strangers(series: Sequence[Series], choices: dict[int, Choice | None]) -> list[int]:
    """Cameras whose pictures fit no reading of the poses, where those of others do."""
    good = [k for k, c in choices.items() if c is not None and c.trusted]
    return [k for k in range(len(series)) if k not in good] if good else []


def _not_of_these_poses(name: str) -> Finding:
    return Finding(
        "unused_camera",
        "warning",
        f"{name}: its pictures do not belong to these poses, those of the others do: not used",
        "leave pictures without poses (of the lens alone) in a folder of their own",
    )


def _pose_row(name: str, cameras: int, choice: Choice) -> ReadAs:
    what = "poses" if cameras == 1 else f"poses, {name}"
    best = choice.best
    words = f"{best.reading.table.source}: {best.words()} ({best.fit.median_px:.1f} px)"
    second = choice.second
    otherwise = (
        "" if second is None else f"{second.words()} ({min(second.fit.median_px, 99999):.0f} px)"
    )
    return ReadAs(what, words, otherwise)
