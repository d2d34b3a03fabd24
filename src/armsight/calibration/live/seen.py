"""What the procedure asks for, what it is answered, and what is left of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats, Ints, JointVector
from armsight.calibration import arm
from armsight.calibration.boards import Board, Checkerboard, Detection, Miss
from armsight.calibration.depth import read_squares
from armsight.calibration.live.setup import Setup, lens_list
from armsight.calibration.problem import ArmView, BoardPlacement, Problem, Rig, Sighting
from armsight.calibration.robot_errors import RobotErrors


@dataclass(frozen=True)
class MoveTo:
    """Bring the arm to rest at joint angles. Reply: whether it arrived."""

    joints: JointVector
    stage: str


@dataclass(frozen=True)
class LookAt:
    """Photograph with some cameras. Reply: :class:`Looked`.

    Attributes:
        cameras: indices; rest: stand still for this long first [s]; frames: exposures to average.
    """

    cameras: tuple[int, ...]
    rest: float
    frames: int


@dataclass(frozen=True)
class Picture:
    """What a camera delivered: grey pictures and depth, None for what it has not.

    ``problem`` says why there is nothing at all, such as a lost camera. Of a stereo pair, ``color``
    is the left lens's picture and ``right`` the other's.
    """

    color: Bytes | None
    infrared: Bytes | None
    depth: DepthImage | None
    problem: str = ""
    right: Bytes | None = None


@dataclass(frozen=True)
class Looked:
    """The reply to :class:`LookAt`: (n,) joint angles that the arm reported meanwhile, pictures.

    ``wrench`` is the mean of what a force sensor at the flange has felt, (6,) in the flange's frame
    [N], [N m]; None where nobody feels.
    """

    joints: JointVector
    pictures: list[Picture]
    wrench: Floats | None = None


@dataclass(frozen=True)
class SeenView:
    """One view that was taken, small enough to be kept in a file.

    Attributes:
        joints: (n,) as the arm reported [rad].
        stage: in which it was taken; stamp: when [s].
        found: (lens index, corner indices, pixels) of each lens that saw the board.
        missed: (lens index, reason) of those that did not.
        depth: of each camera that has one, (camera, pixels, median depths).
    """

    joints: JointVector
    stage: str
    stamp: float
    found: tuple[tuple[int, Ints, Floats], ...]
    missed: tuple[tuple[int, str], ...] = ()
    depth: tuple[tuple[int, Floats, Floats], ...] = ()


Request = MoveTo | LookAt


def read_pictures(
    setup: Setup, joints: JointVector, stage: str, stamp: float, pictures: Sequence[Picture]
) -> SeenView:
    """Find the board in every picture, and read the depth on it."""
    lenses = lens_list(setup.cameras)
    found, missed, depths = [], [], []
    for camera, picture in enumerate(pictures):
        for index, lens in enumerate(lenses):
            if lens.rig != camera:
                continue
            gray = picture.infrared if lens.name.endswith("infrared") else picture.color
            if gray is None:
                missed.append((index, picture.problem or "no picture"))
                continue
            result = setup.board.detect(gray)
            if isinstance(result, Miss):
                missed.append((index, result.reason))
                continue
            found.append((index, result.corner, result.pixel))
            if lens.name.endswith("infrared") and picture.depth is not None:
                scale = setup.cameras[camera].depth_scale
                pixel, z = _board_depth(setup.board, result, picture.depth, scale)
                if len(z):
                    depths.append((camera, pixel, z))
    return SeenView(
        np.asarray(joints, float), stage, stamp, tuple(found), tuple(missed), tuple(depths)
    )


def _board_depth(
    board: Board, seen: Detection, depth: DepthImage, scale: float
) -> tuple[Floats, Floats]:
    if not isinstance(board, Checkerboard):
        return np.zeros((0, 2)), np.zeros(0)
    across, down = board.inner
    grid = np.full((across * down, 2), np.nan)
    grid[seen.corner] = seen.pixel
    j, i = np.mgrid[0 : down - 1, 0 : across - 1]
    # The first inner square lies diagonally inside the (dark) corner square: it is dark as well.
    white = (i + j) % 2 == 1
    return read_squares(depth, grid.reshape(down, across, 2), white, scale)


def problem_of(setup: Setup, views: Sequence[SeenView]) -> Problem:
    """The views as a problem with the sheet's start values."""
    arm_views, sightings = [], []
    for index, view in enumerate(views):
        T = arm.flange_poses(setup.robot, view.joints[None])[0]
        arm_views.append(ArmView(T, view.joints, stamp=view.stamp))
        for lens, corner, pixel in view.found:
            sightings.append(Sighting(index, lens, 0, np.asarray(corner, np.int64), pixel, 0.1))
    return Problem(
        tuple(Rig(c.name) for c in setup.cameras),
        tuple(lens_list(setup.cameras)),
        (BoardPlacement("board", setup.board.points),),
        tuple(arm_views),
        tuple(sightings),
        RobotErrors(setup.robot),
    )
