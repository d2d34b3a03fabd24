"""How a camera's poses are to be read: tables, conventions, pairing and mirrored pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Ints
from armsight.calibration.boards import Board, Checkerboard, CircleGrid, Detection
from armsight.calibration.findings import Finding
from armsight.calibration.hand_eye_fit import board_options
from armsight.calibration.layouts.choice import BETTER, Choice, choose
from armsight.calibration.layouts.lens_files import LensFile
from armsight.calibration.layouts.series import Series
from armsight.calibration.layouts.table import PoseTable
from armsight.calibration.pictures import Seen
from armsight.calibration.problem import Mount
from armsight.calibration.rough_lens import rough_lens
from armsight.calibration.start import planar_poses


def read_poses(
    board: Board,
    series: Series,
    seen: Seen,
    lens: LensFile | None,
    tables: Sequence[PoseTable],
    mount: Mount | None,
) -> tuple[Seen, Choice | None]:
    """The best reading of the poses of a camera's pictures, and what they show.

    Pictures are mirrored back when arm and board agree only so.

    Args:
        board: that was looked for.
        series: the camera's pictures.
        seen: what they show.
        lens: as given, or None.
        tables: all that may be poses.
        mount: where the user says the camera is, or None.

    Returns:
        What the pictures show (mirrored back where they are mirrored), and the reading; None
        where fewer than three pictures show the board.
    """
    found = _choice(board, series, seen, lens, tables, mount)
    if found is None or found.trusted:
        return seen, found
    return _unmirrored(board, series, seen, lens, tables, mount, found)


def _choice(
    board: Board,
    series: Series,
    seen: Seen,
    lens: LensFile | None,
    tables: Sequence[PoseTable],
    mount: Mount | None,
) -> Choice | None:
    again = seen.repeated()  # the pose of a picture that hung is not its own
    found = [(k, d) for k, d in enumerate(seen.detections) if d is not None and k not in again]
    if len(found) < 3 or seen.size is None:
        return None
    camera = (
        lens.camera if lens is not None else rough_lens(board, [d for _, d in found], seen.size)
    )
    index, poses = [], []
    for k, d in found:
        p = planar_poses(camera, board.points[d.corner], d.pixel)
        if p is not None:
            index.append(k)
            poses.append(p.T_lens_board)
    if len(index) < 3:
        return None
    points = np.asarray(board.points, np.float64)
    boards = board_options(poses, board.turns, points, camera.fx)
    gaps = np.linalg.norm(board.points[1:] - board.points[0], axis=1)
    return choose(series, tables, np.array(index), boards, mount, float(gaps.min()))


def _unmirrored(
    board: Board,
    series: Series,
    seen: Seen,
    lens: LensFile | None,
    tables: Sequence[PoseTable],
    mount: Mount | None,
    choice: Choice,
) -> tuple[Seen, Choice]:
    """The same with pictures mirrored back, when arm and board agree only so."""
    order = mirror_order(board)
    if order is None or seen.size is None:
        return seen, choice
    back: list[Detection | None] = []
    for d in seen.detections:
        if d is None:
            back.append(None)
            continue
        corner = order[d.corner]
        sort = np.argsort(corner)
        pixel = np.column_stack([seen.size[0] - 1 - d.pixel[:, 0], d.pixel[:, 1]])
        back.append(replace(d, corner=corner[sort], pixel=pixel[sort]))
    mirrored = replace(seen, detections=tuple(back))
    other = _choice(board, series, mirrored, lens, tables, mount)
    if other is None or not other.trusted:
        return seen, choice
    if other.best.fit.median_px * BETTER > choice.best.fit.median_px:
        return seen, choice
    named = Finding(
        "mirrored",
        "warning",
        f"the pictures of {series.name} are mirrored left to right: arm and board agree only when "
        f"they are mirrored back ({other.best.fit.median_px:.1f} px, as they are "
        f"{choice.best.fit.median_px:.0f} px); read so",
        "switch the camera's mirroring off: the result holds for pictures that are not mirrored",
    )
    return mirrored, replace(other, findings=(named, *other.findings))


def mirror_order(board: Board) -> Ints | None:
    """Which corner each is when a grid is read from its back; None for boards with numbers."""
    if isinstance(board, Checkerboard):
        columns, rows = board.inner
    elif isinstance(board, CircleGrid) and not board.asymmetric:
        columns, rows = board.columns, board.rows
    else:
        return None
    return np.arange(columns * rows).reshape(rows, columns)[:, ::-1].ravel()
