"""A perceiver that looks at the board in passing, and says when a camera was moved.

In a cell that was calibrated by a board, and where the board still hangs: whenever the arm rests
and a camera's colour picture should show the board, it is looked for where it must be, and what is
seen goes to the drift watch (docs/calibration.md). It sees less than the map's own check does; a
camera that it blames is evidence no more until it has been calibrated again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import JointVector, Pose
from armsight.calibration.boards import Board, Miss
from armsight.calibration.drift import Drift, DriftOptions, DriftWatch
from armsight.calibration.known_cell import known_from_cell
from armsight.calibration.problem import ArmView, Sighting
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose, transform
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot
from armsight.workcell import Cell
from armsight.workcell.board import board_of

RATE, SCALE = 2.0, 0.5
"""Colour that it asks for [Hz], and at which share of the lens's own size."""
RESTING = 0.005
"""Joints slower than this rest [rad/s]."""
APART = 0.02
"""Two rests are of the same place if no joint differs by more [rad] ..."""
AGAIN = 3.0
"""... and a place teaches nothing new for so long [s]."""
FALSE_ALARM = 1e-5
"""Probability that a camera which stands still is blamed in a cell: its doubts stay the same."""
AROUND = 60
"""The board is looked for so far about where it must be, at least [px]."""


@dataclass(frozen=True)
class BoardSeen:
    """What the board says of the cameras.

    Attributes:
        stamp: exposure of the oldest picture that it rests on [s].
        sightings: of the board so far.
        excluded: (camera, why nothing that it says may count).
        warning: what is off otherwise, in words; or empty.
    """

    stamp: float
    sightings: int
    excluded: tuple[tuple[str, str], ...] = ()
    warning: str = ""


def board_watch(cell: Cell) -> tuple[BoardWatch, ...]:
    """The watch of a cell; none where no board hangs on the arm or no camera was calibrated."""
    section, calibration = cell.workcell.board, cell.calibration
    if section is None or calibration is None or calibration.board is None:
        return ()
    if section.mounted_on != "flange":
        return ()
    infos = [c.info for c in cell.cameras]
    watched = [
        i
        for i in infos
        if i.covariance is not None and i.color is not None and i.mounted_on == "base"
    ]
    if not watched:
        return ()
    board = board_of(cell.workcell)
    middle = 0.5 * (board.points.max(0) + board.points.min(0))
    T_flange_board: Pose = calibration.board.pose @ make_pose(None, -middle)
    return (BoardWatch(cell.robot, board, T_flange_board, watched),)


class BoardWatch:
    """Looks for the board in the colour pictures of a resting arm."""

    name = "board watch"
    period = 0.2
    latency = 0.1

    def __init__(
        self, robot: Robot, board: Board, T_flange_board: Pose, cameras: Sequence[RgbdCameraInfo]
    ) -> None:
        self.cameras: Sequence[CameraUse] = tuple(CameraUse(c.name, RATE, SCALE) for c in cameras)
        self._robot, self._board, self._T_flange_board = robot, board, T_flange_board
        self._index = {c.name: k for k, c in enumerate(cameras)}
        self._infos = {c.name: c for c in cameras}
        self._known = known_from_cell(cameras, board.points, T_flange_board, "flange")
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        self._watch = DriftWatch(self._known, DriftOptions(false_alarm=FALSE_ALARM))
        self._seen: dict[str, list[tuple[float, JointVector]]] = {}
        self._blamed: dict[str, str] = {}
        self._warning = ""
        self._count = 0

    def update(self, frames: Sequence[PosedFrame]) -> BoardSeen | None:
        """What the pictures of a resting arm show of the board; None if nothing new."""
        found = [s for s in (self._look(f) for f in frames) if s is not None]
        rests: list[tuple[JointVector, list[Sighting]]] = []
        for joints, sighting in found:
            for there, sightings in rests:
                if np.abs(there - joints).max() < APART:
                    sightings.append(sighting)
                    break
            else:
                rests.append((joints, [sighting]))
        for joints, sightings in rests:
            T = flange_pose(self._robot, joints)
            self._note(self._watch.add(ArmView(T, joints), sightings))
            self._count += len(sightings)
        if not found:
            return None
        stamp = min(f.frame.stamp for f in frames)
        return BoardSeen(stamp, self._count, tuple(self._blamed.items()), self._warning)

    def _note(self, drift: Drift | None) -> None:
        if drift is None:
            return
        if drift.cause == "camera":
            for name in drift.cameras:
                self._blamed[name] = (
                    f"was moved since it was calibrated, by about {1e3 * drift.shift:.0f} mm and "
                    f"{np.rad2deg(drift.turn):.1f} deg by what it sees of the board; calibrate it "
                    "again"
                )
        else:
            self._warning = drift.message

    def _look(self, posed: PosedFrame) -> tuple[JointVector, Sighting] | None:
        name, joints, lens = posed.frame.camera, posed.joints, posed.color_lens
        color = posed.frame.color
        if joints is None or lens is None or color is None or name not in self._index:
            return None
        if name in self._blamed or np.abs(joints.velocity).max() > RESTING:
            return None
        stamp, q = posed.frame.stamp, np.asarray(joints.position, float)
        places = [p for p in self._seen.get(name, []) if p[0] > stamp - AGAIN]
        if any(np.abs(there - q).max() < APART for _, there in places):
            return None
        window = self._window(self._infos[name], lens, q)
        if window is None:
            return None
        u0, v0, u1, v1 = window
        gray = cv2.cvtColor(color[v0:v1, u0:u1], cv2.COLOR_RGB2GRAY)
        seen = self._board.detect(np.asarray(gray, np.uint8))
        if isinstance(seen, Miss):
            return None
        self._seen[name] = [*places, (stamp, q)]
        full = self._infos[name].color
        assert full is not None
        corner = np.array([u0 + 0.5, v0 + 0.5])
        pixel = (seen.pixel + corner) * (full.width / lens.width) - 0.5
        return q, Sighting(0, self._index[name], 0, seen.corner, pixel)

    def _window(
        self, info: RgbdCameraInfo, lens: PinholeCamera, joints: JointVector
    ) -> tuple[int, int, int, int] | None:
        """(u0, v0, u1, v1) about where the board must be; None where it cannot be seen whole."""
        T_base_board = flange_pose(self._robot, joints) @ self._T_flange_board
        T_lens_board = inverse(info.T_mount_camera @ info.T_depth_color) @ T_base_board
        # Its print lies away from its z axis: towards the camera is against it.
        if float(T_lens_board[:3, 2] @ T_lens_board[:3, 3]) <= 0.0:
            return None
        at = transform(T_lens_board, self._board.points)
        if at[:, 2].min() < 0.1:
            return None
        pixel = lens.project(at)
        low, high = pixel.min(0), pixel.max(0)
        if (low < 0.0).any() or (high > [lens.width - 1, lens.height - 1]).any():
            return None
        margin = max(AROUND, 0.3 * float((high - low).max()))
        u0, v0 = np.maximum(low - margin, 0).astype(int)
        u1, v1 = np.minimum(high + margin + 1, [lens.width, lens.height]).astype(int)
        return int(u0), int(v0), int(u1), int(v1)
