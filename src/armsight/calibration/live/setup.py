"""What there is to calibrate, as believed before: arm, cameras, board."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.calibration.boards import Board
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.problem import Lens
from armsight.calibration.views import FreeCheck
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class CameraSetup:
    """A camera as believed before calibration.

    Attributes:
        name: of the camera.
        infrared, color: lenses by the sheet, None for one that delivers no such picture.
        T_infrared_color: colour lens in the infrared one by the sheet.
        keep: the lenses are factory calibrated and kept.
        depth_scale: infrared picture's pixels a depth pixel.
    """

    name: str
    infrared: PinholeCamera | None
    color: PinholeCamera | None
    T_infrared_color: Pose
    keep: bool = False
    depth_scale: float = 1.0


@dataclass(frozen=True)
class Setup:
    """What is there to calibrate.

    Attributes:
        robot: the arm with its tool; cameras: as believed; board: which.
        T_flange_board: of the board's middle, a guess (T1: the flange's centre, facing out).
        free: whether the arm may stand at joint angles; None trusts it everywhere.
        path: whether it may go straight from one configuration to another; None trusts it.
        speed, acceleration: share of the arm's limits that moves use.
        frame_seconds: between exposures [s].
    """

    robot: Robot
    cameras: tuple[CameraSetup, ...]
    board: Board
    T_flange_board: Pose
    free: FreeCheck | None = None
    path: Callable[[JointVector, JointVector], bool] | None = None
    speed: float = 0.5
    acceleration: float = 0.6
    frame_seconds: float = 1 / 15


def lens_list(cameras: Sequence[CameraSetup]) -> list[Lens]:
    """Lenses of all cameras: infrared first, then colour, camera by camera.

    Raises:
        UsageError: a camera has none.
    """
    out: list[Lens] = []
    for index, c in enumerate(cameras):
        first = c.infrared if c.infrared is not None else c.color
        if first is None:
            raise UsageError(f"camera {c.name} has neither an infrared nor a colour lens")
        kind = "color" if c.infrared is None else "infrared"
        out.append(Lens(f"{c.name} {kind}", index, first, prior=sheet_prior(first), keep=c.keep))
        if c.color is not None and c.infrared is not None:
            prior = sheet_prior(c.color)
            out.append(
                Lens(
                    f"{c.name} color",
                    index,
                    c.color,
                    c.T_infrared_color,
                    not c.keep,
                    prior,
                    keep=c.keep,
                )
            )
    return out


def board_middle(setup: Setup) -> Floats:
    """(3,) the middle of the corners in the board's frame [m]."""
    p = setup.board.points
    return np.asarray(0.5 * (p.max(0) + p.min(0)))
