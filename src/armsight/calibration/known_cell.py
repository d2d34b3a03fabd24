"""What a calibrated cell holds to be true of its cameras and its board, for the drift watch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Ints, Points, Pose
from armsight.calibration.drift import Known
from armsight.calibration.model import Model
from armsight.calibration.problem import (
    BoardPlacement,
    Freedom,
    Lens,
    Mount,
    Priors,
    Problem,
    Rig,
    lens_vector,
)
from armsight.devices.data import RgbdCameraInfo

BOARD = (0.001, 0.002)
"""How surely a calibrated board hangs where it is said to (translation [m], rotation [rad])."""
FOCAL, CENTER = 0.001, 1.0
"""How surely a calibrated lens is known: focal length (share) and principal point [px]."""
NOISE = 0.3
"""Of a corner's coordinate in one picture [px]."""
ARM = (0.0005, 0.0008)
"""Error of a calibrated arm that its pose keeps (translation [m], rotation [rad])."""


def known_from_cell(
    cameras: Sequence[RgbdCameraInfo], points: Points, T_mount_board: Pose, mount: Mount
) -> Known:
    """What a cell's calibration file says, as far as the board can judge it.

    Args:
        cameras: calibrated, each with a colour lens and a covariance.
        points: (k, 3) corners of the board in its frame [m].
        T_mount_board: where it hangs by the calibration.
        mount: on what.

    Raises:
        ValueError: a camera is not calibrated, or has no colour.
    """
    lenses, rigs = [], []
    for index, info in enumerate(cameras):
        if info.covariance is None or info.color is None:
            raise ValueError(f"camera {info.name} is not calibrated, or has no colour")
        rigs.append(
            Rig(info.name, "base" if info.mounted_on == "base" else "flange", info.T_mount_camera)
        )
        lenses.append(Lens(f"{info.name} color", index, info.color, info.T_depth_color))
    problem = Problem(
        tuple(rigs), tuple(lenses), (BoardPlacement("board", points, mount, T_mount_board),), (), ()
    )
    freedom = Freedom(lens=True, white=None)
    model = Model(problem, freedom)
    priors = Priors()
    shape = np.array([priors.board_scale, priors.board_warp, priors.board_warp])
    doubts: list[tuple[slice, Floats]] = [
        (model.board_slice(0), _sure(*BOARD)),
        (model.shape_slice(0), np.diag(shape**2)),
    ]
    for index, info in enumerate(cameras):
        assert info.covariance is not None
        assert info.color is not None
        doubts.append((model.rig_slice(index), info.covariance))
        first = model.lens_slice(index).start
        sigma = np.array([*FOCAL * lens_vector(info.color)[:2], CENTER, CENTER])
        doubts.append((slice(first, first + 4), np.diag(sigma**2)))
    unknown, covariance = _together(doubts)
    noise = dict.fromkeys(range(len(lenses)), NOISE)
    return Known(problem, model.start(), freedom, unknown, covariance, noise, ARM)


def _sure(meters: float, radians: float) -> Floats:
    return np.diag([meters**2] * 3 + [radians**2] * 3)


def _together(doubts: Sequence[tuple[slice, Floats]]) -> tuple[Ints, Floats]:
    """Indices of all that is doubted, and their covariance: independent of one another."""
    unknown = np.concatenate([np.arange(at.start, at.stop) for at, _ in doubts])
    covariance = np.zeros((len(unknown), len(unknown)))
    begin = 0
    for _, C in doubts:
        covariance[begin : begin + len(C), begin : begin + len(C)] = C
        begin += len(C)
    order = np.argsort(unknown)
    return unknown[order], covariance[np.ix_(order, order)]
