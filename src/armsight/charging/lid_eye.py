"""The perceiver of lids: a pair's pictures in, the shut lid that they show out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import ColorImage, Floats, Pose
from armsight.charging.eye import drawn_edges, gray, picture_fault
from armsight.charging.fit import model_points
from armsight.charging.lid_find import LidPose, find_lid, fit_lid
from armsight.charging.vehicle_file import LidShape
from armsight.geometry.pose import inverse
from armsight.motion.perception import CameraUse, PosedPair


@dataclass(frozen=True, eq=False)
class LidLook:
    """What one exposure of a pair showed of a lid.

    Attributes:
        stamp: of the exposure [s]; pair: its name.
        T_base_lid: where it is when it is shut; None where none is seen.
        covariance: (6, 6) of that as a twist in its own frame [m], [rad].
        score: share of its edges that were seen, 0..1.
        picture: with its edges; the whole left picture where there is none.
    """

    stamp: float
    pair: str
    T_base_lid: Pose | None
    covariance: Floats
    score: float
    picture: ColorImage


class LidEye:
    """Looks for a shut lid in the pictures of one pair, while the task wants them.

    Args:
        pair: its name; shape: of the lid.

    Attributes:
        expected: ``T_base_lid`` about where it is, once that is known: then it looks there only.
    """

    latency = 0.6
    period = 0.3
    cameras: tuple[CameraUse, ...] = ()
    on_demand = True

    def __init__(self, pair: str, shape: LidShape) -> None:
        self.name = f"lids/{pair}"
        self.stereo = (pair,)
        self.expected: Pose | None = None
        self._shape = shape

    def warm_up(self) -> None:
        """Nothing: what finds ports has compiled what fits lids."""

    def update(self, frames: Sequence[PosedPair]) -> LidLook | None:
        """See :class:`~armsight.motion.perception.Perceiver`."""
        view = frames[-1]
        frame, info, T_base_left = view.frame, view.info, view.T_base_camera
        if T_base_left is None or picture_fault(frame.left, frame.right, info.left, info.right):
            return None
        images = gray(frame.left), gray(frame.right)
        pair = info.lenses
        expected = self.expected
        found: LidPose | None
        if expected is None:
            found = find_lid(images, pair, self._shape)
        else:
            found = fit_lid(images, pair, inverse(T_base_left) @ expected)
        edges = None
        if found is not None:
            edges = info.left.project(model_points(found.fit)), found.fit.found
        return LidLook(
            frame.stamp,
            info.name,
            None if found is None else np.asarray(T_base_left @ found.T_left_lid),
            np.eye(6) if found is None else found.covariance,
            0.0 if found is None else found.score,
            drawn_edges(frame.left, edges),
        )
