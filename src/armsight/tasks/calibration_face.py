"""What a running calibration shows: stage, views, falling doubt, coverage of every image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from armsight.arrays import Bytes
from armsight.calibration import arm
from armsight.calibration.live.seen import SeenView
from armsight.calibration.live.setup import Setup, board_middle, lens_list
from armsight.calibration.live.watcher import Progress, Watcher
from armsight.geometry.pose import make_pose
from armsight.motion.face import Curve, EllipsoidMark, Face, Figure, FrameMark, Picture, PointsMark

TILE = 280
"""Width of one lens's coverage picture [px]."""
DOT, PAPER = (56, 189, 248), (26, 30, 36)
GROWN = 20.0
"""Ellipsoids of doubt are drawn this many times as large as they are."""


class CalibrationFace:
    """Is told by the procedure, tells another watcher, and makes a face of it."""

    def __init__(self, setup: Setup, watcher: Watcher, done: Sequence[SeenView] = ()) -> None:
        self._setup, self._watcher = setup, watcher
        self._lenses = lens_list(setup.cameras)
        self._progress = Progress("starting", len(done), (), ())
        self._places: list[Bytes] = [self._empty(k) for k in range(len(self._lenses))]
        self._boards: list[tuple[float, float, float]] = []
        for view in done:
            self._note(view)

    def stage(self, progress: Progress) -> None:
        """A step was done."""
        answer = progress.answer if progress.answer is not None else self._progress.answer
        self._progress = Progress(
            progress.stage, progress.views, progress.seen, progress.expected, answer
        )
        self._watcher.stage(progress)

    def view(self, view: SeenView) -> None:
        """A view was taken."""
        self._note(view)
        self._watcher.view(view)

    def face(self) -> Face:
        """As it is now."""
        p = self._progress
        sure = [e for e in p.expected if np.isfinite(e)]
        worst = 1e3 * max(sure) if sure else float("nan")
        figures = [Figure("views", float(p.views))]
        figures += [
            Figure(f"boards seen by {lens.name}", float(seen))
            for lens, seen in zip(self._lenses, p.seen)
        ]
        if sure:
            figures.append(Figure("points known to", worst, "mm"))
        marks: list[FrameMark | EllipsoidMark | PointsMark] = []
        if self._boards:
            marks.append(PointsMark("boards", np.array(self._boards), 0.012, DOT))
        answer = p.answer
        for index, camera in enumerate(self._setup.cameras if answer is not None else ()):
            assert answer is not None
            T, C = answer.camera_pose(index), answer.covariance.camera_pose(index)
            spread = T[:3, :3] @ C[:3, :3] @ T[:3, :3].T * GROWN**2
            marks.append(FrameMark(f"camera {camera.name}", T))
            marks.append(EllipsoidMark.of(f"doubt about {camera.name}", T[:3, 3], spread))
        return Face(
            state=p.stage,
            figures=tuple(figures),
            curves=(Curve("points known to", worst, "mm"),),
            pictures=tuple(
                Picture(f"boards in {lens.name}", image)
                for lens, image in zip(self._lenses, self._places)
            ),
            marks=tuple(marks),
        )

    def _empty(self, lens: int) -> Bytes:
        camera = self._lenses[lens].camera
        height = max(int(TILE * camera.height / camera.width), 8)
        return np.full((height, TILE, 3), PAPER, np.uint8)

    def _note(self, view: SeenView) -> None:
        T = arm.flange_poses(self._setup.robot, view.joints[None])[0]
        board = T @ self._setup.T_flange_board @ make_pose(None, board_middle(self._setup))
        x, y, z = board[:3, 3]
        self._boards.append((float(x), float(y), float(z)))
        for lens, _, pixel in view.found:
            image = self._places[lens].copy()
            scale = TILE / self._lenses[lens].camera.width
            hull = cv2.convexHull((scale * pixel).astype(np.float32)).astype(np.int32)
            shade = image.copy()
            cv2.fillConvexPoly(shade, hull, DOT)
            self._places[lens] = np.asarray(cv2.addWeighted(shade, 0.35, image, 0.65, 0), np.uint8)
