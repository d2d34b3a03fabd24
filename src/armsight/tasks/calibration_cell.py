"""What there is to calibrate in a cell, and how its session differs from a guarded one's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration.live.setup import CameraSetup, Setup
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.history import JointHistory
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.mapping.config import MappingConfig
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.motion.collision import CollisionModel
from armsight.motion.planner import PlannerConfig
from armsight.workcell.board import board_mount, board_of
from armsight.workcell.schema_things import BoardSection

if TYPE_CHECKING:
    from armsight.workcell import Cell, Workcell

CLEARANCE, OUTER = 0.03, 3
"""The board's true bracket is off by a centimetre or two: links from this one on keep away from
everything declared [m]."""


def calibration_setup(cell: Cell, mapping: MappingConfig, keep_lenses: bool = False) -> Setup:
    """A cell as believed before calibration.

    Args:
        cell: open, with a board on its arm.
        mapping: of the session; its static map says where the arm may stand.
        keep_lenses: the lenses that the cameras report are believed.

    Raises:
        CalibrationError: the cell has no camera, or no board on its arm.
        WorkcellError: its board is no board.
    """
    workcell = cell.workcell
    if not cell.cameras:
        raise CalibrationError(f"{workcell.name}: has no [[camera]] to calibrate")
    section = workcell.board
    if section is None or section.mounted_on != "flange":
        raise CalibrationError(
            f"{workcell.file or workcell.name}: live calibration needs a [board] with "
            'mounted_on = "flange"; say which board the arm carries, and where'
        )
    carried = [c.info.name for c in cell.cameras if c.info.mounted_on != "base"]
    if carried:
        raise CalibrationError(
            f"{workcell.name}: camera {carried[0]} is on the flange, and so is the board: it "
            "cannot see it; record images with the board beside the arm, and use --from"
        )
    free, path = free_checks(cell, mapping)
    return Setup(
        cell.robot,
        tuple(_camera(c.info, keep_lenses) for c in cell.cameras),
        board_of(workcell),
        board_mount(workcell),
        free,
        path,
        workcell.robot.speed,
        workcell.robot.acceleration,
        1.0 / min(c.info.rate for c in cell.cameras),
    )


def to_calibrate(workcell: Workcell, board: str | None = None) -> Workcell:
    """A cell whose cameras are no evidence for its map: they are about to be calibrated.

    Args:
        workcell: as its file says.
        board: another kind of board than the file's, in the same place.
    """
    cameras = tuple(c.model_copy(update={"guard": False}) for c in workcell.camera)
    changes: dict[str, object] = {"camera": cameras}
    if board is not None:
        section = workcell.board or BoardSection()
        changes["board"] = section.model_copy(update={"kind": board})
    return workcell.model_copy(update=changes)


def unseen_is_empty(mapping: MappingConfig) -> MappingConfig:
    """The map's settings for a cell of which somebody has made sure that nobody is in it."""
    return replace(mapping, unseen_is_empty=True, unknown_is_solid=False)


def _camera(info: RgbdCameraInfo, keep: bool) -> CameraSetup:
    scale = info.infrared_scale
    if scale == 0 and info.color is None:
        raise CalibrationError(
            f"camera {info.name} ({info.model}) delivers neither a picture of its depth lens nor "
            "colour: there is nothing to find a board in"
        )
    infrared = None if scale == 0 else info.depth.scaled(scale) if scale > 1 else info.depth
    if keep:
        return CameraSetup(
            info.name, infrared, info.color, info.T_depth_color, keep=True, depth_scale=scale
        )
    return CameraSetup(
        info.name,
        None if infrared is None else _sheet(infrared),
        None if info.color is None else _sheet(info.color),
        make_pose(None, info.T_depth_color[:3, 3]),
        depth_scale=scale,
    )


def _sheet(lens: PinholeCamera) -> PinholeCamera:
    """What the maker's sheet says of a lens: its focal length, the middle, no distortion."""
    f = 0.5 * (lens.fx + lens.fy)
    return PinholeCamera(
        lens.width, lens.height, f, f, 0.5 * (lens.width - 1), 0.5 * (lens.height - 1)
    )


def free_checks(
    cell: Cell, mapping: MappingConfig
) -> tuple[Callable[[JointVector], bool], Callable[[JointVector, JointVector], bool]]:
    """Whether the arm may stand somewhere, and whether it may go straight from place to place.

    As the guard's planner judges, and a little stricter. Views that need a way round are not worth
    its time: there are always others.
    """
    static = WorkspaceMap(cell.robot, (), cell.static, unseen_is_empty(mapping))
    snapshot = static.update((), JointHistory(), 0.0)
    static.close()
    model = CollisionModel(cell.robot).with_room(PlannerConfig().room)
    # The shoulder stands beside what carries it; what holds the board keeps a distance.
    outer = cell.robot.spheres.link[model.body.original] >= OUTER

    def free(joints: JointVector) -> bool:
        q = np.asarray(joints, float)
        if not model.valid(q, snapshot):
            return False
        return bool(model.clearances(q, snapshot)[outer].min(initial=np.inf) > CLEARANCE)

    def path(start: JointVector, end: JointVector) -> bool:
        return bool(model.edge_valid(np.asarray(start, float), np.asarray(end, float), snapshot))

    return free, path
